"""SlamMap: what SLAM leaves behind: keyframes with their poses, their graph, and the occupancy that they show."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from curvescan.configs import counted
from curvescan.errors import MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.scan import LaserScan
from curvescan.slam.map_file import read_map_file, write_map_file
from curvescan.slam.pose_graph.graph import PoseGraph
from curvescan.types import Cov, Floats, Ints, Pose, PoseEdge


@dataclass(frozen=True, eq=False, kw_only=True)
class SlamMap:
    """A map that is saved, loaded, continued, and localized in.

    Of each keyframe a row: `scans`, ranges as precise as float32; `poses` (n, 3) in the frame ``map``; `covariances`
    (n, 3, 3), the first keyframe known exactly; `indices` (n,), number of the scan in its session; `sessions` (n,). Of
    each edge: `ends` (m, 2), keyframes i and j; `measured` (m, 3), pose of j in the frame of i; `edge_covariances`
    (m, 3, 3); `kinds` (m,), an EdgeKind; `weights` (m,) in [0, 1]. `grid`: occupancy from all scans of a run, None
    or without cells where only the keyframes can tell. Poses are [x, y, theta], metres, radians, float64; rows int64.
    """

    scans: tuple[LaserScan, ...]
    poses: Pose
    covariances: Cov
    indices: Ints
    sessions: Ints
    ends: Ints
    measured: Pose
    edge_covariances: Cov
    kinds: Ints
    weights: Floats
    grid: OccupancyGrid | None = None

    def __len__(self) -> int:
        return len(self.scans)

    def __repr__(self) -> str:
        sessions = f"{self.n_sessions} session{'s' * (self.n_sessions != 1)}"
        return f"SlamMap({counted(len(self), 'keyframe')}, {counted(len(self.ends), 'edge')}, {sessions})"

    @property
    def n_sessions(self) -> int:
        """Sessions that the map was made in."""
        return int(self.sessions.max(initial=-1)) + 1

    @property
    def edges(self) -> Iterator[PoseEdge]:
        """The edges that the optimum follows, as records."""
        for k in np.flatnonzero(self.weights > 0.5).tolist():
            i, j = self.ends[k].tolist()
            yield PoseEdge(i=i, j=j, pose=self.measured[k], covariance=self.edge_covariances[k])

    def graph(self) -> PoseGraph:
        """Return the poses and the edges as a graph of their own."""
        graph = PoseGraph()
        for pose in self.poses:
            graph.add_pose(pose)
        edges = zip(self.ends.tolist(), self.measured, self.edge_covariances, self.kinds, self.weights, strict=True)
        for (i, j), *edge in edges:
            graph.add_edge(i, j, *edge)
        return graph

    def occupancy(self, config: OccupancyConfig | None = None) -> OccupancyGrid:
        """Return the occupancy that was stored; with a config, or where none was, that of the keyframes."""
        if config is None and self.grid is not None:
            if self.grid.log_odds.size:
                return self.grid
            config = self.grid.config
        builder = OccupancyBuilder(config)
        for scan, pose in zip(self.scans, self.poses, strict=True):
            builder.add(scan, pose)
        return builder.grid(is_last=True)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map and its occupancy to a file, NAME.csmap by custom; see docs/maps.md. Raises OutputError."""
        whole = self
        with suppress(MapTooLargeError):  # then without
            whole = replace(self, grid=self.occupancy()) if self.scans else self
        write_map_file(path, whole)


def as_map(given: SlamMap | str | os.PathLike[str]) -> SlamMap:
    """Return a map that is given as one, or as the path of its file."""
    return given if isinstance(given, SlamMap) else load_map(given)


def load_map(path: str | os.PathLike[str]) -> SlamMap:
    """Return a map that was saved to a .csmap file.

    Raises LogFileError when it cannot be opened, LogFormatError when it is damaged, no map, or of a later version.
    """
    return SlamMap(**read_map_file(path))
