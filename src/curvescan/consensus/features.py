"""All that the matcher knows of one scan, computed once and used whether it is the current scan or the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan.consensus.config import ConsensusConfig
from curvescan.consensus.keypoints import find_ends, find_keypoints
from curvescan.consensus.polar import polar_lookup
from curvescan.consensus.surfaces import fit_surfels, moments, sweep
from curvescan.consensus.probes import choose_probes
from curvescan.scan import LaserScan
from curvescan.types import Floats, Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class ConsensusFeatures:
    """Surfels, characteristic points and the polar frame of one scan.

    Attributes
    ----------
    n_beams : int
        Beams of the scan.
    beam_idx : (m,) int64
        The scan's own index of each valid reading, readings counter-clockwise from a breakpoint on.
    surfels : (m, 9) float64
        The readings and the lines through them; columns as in surfaces.py; sensor frame, metres.
    bounds : (s + 1,) int64
        Surface k is surfels[bounds[k]:bounds[k + 1]].
    lookup : (n_beams,) int64
        Reading in each direction, counter-clockwise; -1 where there is none.
    fan : (4,) float64
        Entries as in polar.py.
    keypoints : (k, 5) float64
        Frames; columns as in keypoints.py.
    probes : (p,) int64
        Readings that stand for all of them when a hypothesis is tried.
    """

    n_beams: int
    beam_idx: Ints
    surfels: Floats
    bounds: Ints
    lookup: Ints
    fan: Floats
    keypoints: Floats
    probes: Ints


def extract_features(scan: LaserScan, config: ConsensusConfig) -> ConsensusFeatures:
    """Return the features of a scan, also of one without a valid reading."""
    n = len(scan)
    step = abs(scan.angle_increment)
    is_clockwise, is_closed = scan.angle_increment < 0.0, scan.is_full_circle
    angle_min = scan.angle_min + (scan.angle_increment * (n - 1) if is_clockwise else 0.0)
    beam_idx, surfels, bounds = sweep(
        scan.ranges,
        scan.directions,
        scan.valid,
        is_clockwise,
        is_closed,
        step,
        config.surface.incidence_limit,
        config.surface.max_gap,
    )
    sums = moments(surfels)
    sigma = fit_surfels(surfels, sums, bounds, config.surface.arm, config.surface.range_sigma_min)
    corners = find_keypoints(surfels, sums, bounds, np.array([0.12, 0.25, 0.5]), 0.4, 96)
    ends = find_ends(surfels, sums, bounds, 0.25, is_closed, 64)
    return ConsensusFeatures(
        n_beams=n,
        beam_idx=beam_idx,
        surfels=surfels,
        bounds=bounds,
        lookup=polar_lookup(beam_idx, n, is_clockwise),
        fan=np.array([angle_min, 1.0 / step, float(is_closed), sigma]),
        keypoints=np.concatenate((corners, ends)),
        probes=choose_probes(surfels, step, 48),
    )
