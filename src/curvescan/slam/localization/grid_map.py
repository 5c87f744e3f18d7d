"""A plain occupancy map made fit for localization: from free places it is looked at as a laser would.

Other programs leave cells: a picture with its YAML file, as ROS's map_server has it. Matches need scans. So beams are
cast from free places, a step apart, and the scans become the keyframes of a map that is known exactly. Beams end at the
first occupied cell, nearest to its centre; those that leave the known part say nothing.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from curvescan.errors import LogFileError, LogFormatError
from curvescan.mapping.map_server import read_map
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.scan import LaserScan
from curvescan.slam.config import SlamConfig
from curvescan.slam.localization.correlative import STEP_M
from curvescan.slam.localization.field import DistanceField, field_of, field_of_grid
from curvescan.slam.map import SlamMap, as_map, load_map
from curvescan.types import Floats, Points

_VIEWS_M = 1.0
"""Places that the map is looked at from lie so far from each other, metres, and a step of the search from walls."""

_N_PLACES = 2000
"""Such places at most; in larger maps they lie farther apart."""

_N_BEAMS, _REACH_M = 720, 30.0
"""Beams all around, and how far they reach, metres."""

_EXACT = 1e-6
"""Variance of where the places lie to each other: next to nothing, square metres and radians."""


def opened(given: SlamMap | OccupancyGrid | str | os.PathLike[str]) -> SlamMap | OccupancyGrid:
    """Return a map to localize in; given as one, or as the file of one: of SLAM, or of cells, YAML or PGM."""
    if not isinstance(given, str | os.PathLike):
        return given if isinstance(given, OccupancyGrid) else as_map(given)
    path = Path(given)
    if path.suffix.lower() in (".pgm", ".png") and path.is_file():
        beside = [file for suffix in (".yaml", ".yml") if (file := path.with_suffix(suffix)).is_file()]
        if not beside:
            raise LogFileError(
                f"{path} is a picture: {path.stem}.yaml beside it, which says where it lies and how large its cells "
                "are, is missing; the map.csmap of `curvescan slam` needs none"
            )
        path = beside[0]
    return read_map(path) if path.suffix.lower() in (".yaml", ".yml") else load_map(path)


def with_field(found: SlamMap | OccupancyGrid, config: SlamConfig) -> tuple[SlamMap, DistanceField, SlamConfig]:
    """Return a map to localize in, its field, and the configuration: walls of a plain map are known to half a cell."""
    if isinstance(found, SlamMap):
        return found, field_of(found), config
    field, noise = field_of_grid(found), config.noise
    noise = replace(noise, floor_m=max(noise.floor_m, found.resolution / 4))  # a pose errs by two of it
    return map_of_grid(found, field), field, replace(config, noise=noise)


def map_of_grid(grid: OccupancyGrid, field: DistanceField | None = None) -> SlamMap:
    """Return a plain map with what a laser would see from its free places as keyframes."""
    field = field or field_of_grid(grid)
    step = _VIEWS_M
    while len(places := field.places(step, STEP_M)) > _N_PLACES:
        step *= float(np.sqrt(len(places) / _N_PLACES))
    if not len(places):
        raise LogFormatError(f"the map has no free place {STEP_M} m clear of walls: its free_thresh or negate is wrong")
    n = len(places)
    ends = np.column_stack((np.zeros(n - 1, dtype=np.int64), np.arange(1, n)))
    poses = np.column_stack((places, np.zeros(n)))
    angle = 2.0 * np.pi / _N_BEAMS
    scan = partial(LaserScan, angle_min=-np.pi, angle_increment=angle, range_min=0.0, range_max=_REACH_M)
    return SlamMap(
        scans=tuple(map(scan, _cast(field, places))),
        poses=poses,
        covariances=np.zeros((n, 3, 3)),
        indices=np.arange(n),
        sessions=np.zeros(n, dtype=np.int64),
        ends=ends,
        measured=poses[1:] - poses[0],
        edge_covariances=np.tile(_EXACT * np.eye(3), (n - 1, 1, 1)),
        kinds=np.zeros(n - 1, dtype=np.int64),
        weights=np.ones(n - 1),
        grid=grid,
    )


def _cast(field: DistanceField, places: Points) -> Floats:
    """Return (n, _N_BEAMS) ranges from places (n, 2); NaN where a beam meets no wall."""
    angles = -np.pi + 2.0 * np.pi / _N_BEAMS * np.arange(_N_BEAMS)
    ways = np.column_stack((np.cos(angles), np.sin(angles)))
    n_rows, n_columns = field.distance.shape
    ranges = np.full((len(places), _N_BEAMS), np.nan)
    for place, row in zip(places, ranges, strict=True):
        beams, along = np.arange(_N_BEAMS), np.zeros(_N_BEAMS)
        while len(beams):
            ends = place + along[:, np.newaxis] * ways[beams]
            columns, rows = np.floor((ends - field.origin) / field.resolution).astype(np.int64).T
            inside = (columns >= 0) & (columns < n_columns) & (rows >= 0) & (rows < n_rows) & (along < _REACH_M)
            beams, along, columns, rows = beams[inside], along[inside], columns[inside], rows[inside]
            free = field.distance[rows, columns].astype(np.float64)
            hit = free == 0.0
            centres = field.origin + field.resolution * (np.column_stack((columns, rows))[hit] + 0.5)
            row[beams[hit]] = np.einsum("ni,ni->n", centres - place, ways[beams[hit]])
            # a thin rim of the unknown often lies before a wall
            go = ~hit & (field.is_free[rows, columns] | (free < 2.5 * field.resolution))
            beams, along = beams[go], along[go] + np.maximum(free[go] - field.resolution, 0.5 * field.resolution)
    return ranges
