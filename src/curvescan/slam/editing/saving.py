"""The folder of a map that was edited."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from curvescan.io.files.output import output_folder
from curvescan.io.trajectories.g2o import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.map_server import write_map
from curvescan.slam.editing.edits import Edit, write_edits
from curvescan.slam.map import SlamMap


def save_map_folder(out: str | os.PathLike[str], slam_map: SlamMap, edits: Sequence[Edit]) -> tuple[str, ...]:
    """Write map.csmap, graph.g2o, map.pgm with map.yaml, and the edits, and return the names of the files."""
    with output_folder(out) as folder:
        grid = slam_map.occupancy()
        replace(slam_map, grid=grid).save(folder / "map.csmap")
        keyframes = Trajectory(stamps=np.array([scan.stamp for scan in slam_map.scans]), poses=slam_map.poses)
        write_g2o(folder / "graph.g2o", keyframes, slam_map.edges)
        if grid.log_odds.size:
            write_map(folder, grid)
        write_edits(folder / "edits.json", edits)
        return tuple(sorted(file.name for file in folder.iterdir()))
