"""LiveMap: the occupancy map and the path so far, drawn anew when poses of the past change."""

from __future__ import annotations

import math
import tempfile
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

import curvescan
from curvescan import se2
from curvescan._compilation import watch
from curvescan.deskew import deskew
from curvescan.engines.engine import Engine
from curvescan.errors import MapTooLargeError
from curvescan.live.tracker import Pace, TrackedScan, Tracker
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.matchers import DEFAULT_METHOD
from curvescan.scan import LaserScan
from curvescan.simulation.driving.pursuit import Drive
from curvescan.simulation.recording import simulate
from curvescan.simulation.sensing.sensors import SENSORS
from curvescan.slam import SlamMap
from curvescan.types import Floats, Pose

_MOVED = 0.05  # a scan enters the map when the sensor has moved by this much, metres or radians
_PATH_STEP_M = 0.03  # points of the path are this far apart at least, metres: memory follows the way and not the time
_MAX_PATH = 50_000  # points of the path at most

_KEPT_M, _KEPT_RAD = 0.15, 0.35
"""A scan is kept, to draw the map anew, for each square of this side and each sector of this angle, metres and radians:
the newest that was taken there, so that memory follows the area and not the time."""

_DARK = 20.0  # grey of the surest obstacle; the surest free space is white, 255


_LOST, _UNSURE = ("bad", "Lost"), ("warn", "Not sure")
_STATUSES = {"predicted": _UNSURE, "held": _LOST, "lost": _LOST, "searching": _LOST}


def status_of(outcome: str, *, is_degenerate: bool = False) -> tuple[str, str]:
    """Return the tone of a colour and the word of a day for the outcome, by its name, of a scan."""
    return _STATUSES.get(outcome, _UNSURE if is_degenerate else ("good", "Tracking"))


class LiveMap:
    """A map and a path that grow with each tracked scan."""

    def __init__(self, config: OccupancyConfig | None = None, *, is_revisable: bool = False) -> None:
        self._config, self._is_revisable = config, is_revisable
        self._builder = OccupancyBuilder(config)
        self._mapped: Pose | None = None
        self._kept: dict[tuple[int, int, int], tuple[int, LaserScan, Pose]] = {}  # each with the pose that it had
        self._path, self._path_indices = array("d"), array("q")
        self._path_step = _PATH_STEP_M
        self._revised: Pose | None = None
        self._redraws = Pace(1.0, 0.2)
        self.path_version = 0
        self.version = 0
        self.why_no_grid = ""  # why no more scans enter it, a sentence; else empty

    def add(self, tracked: TrackedScan) -> None:
        """Take in a tracked scan."""
        if tracked.revised is not None:
            self.revise(tracked.revised.poses)
        if self._revised is not None and self._redraws.is_due:
            self.redraw()
        pose = tracked.step.pose
        if np.isnan(pose).any():
            return
        if not len(self._path) or _is_far(pose, np.array(self._path[-3:]), self._path_step, 1e9):
            self._path.extend(pose)
            self._path_indices.append(tracked.index)
            if self.n_path > _MAX_PATH:  # every second point is forgotten, and they are taken half as often from now on
                self._path = array("d", np.array(self._path).reshape(-1, 3)[::2].tobytes())
                self._path_indices = self._path_indices[::2]
                self._path_step *= 2.0
                self.path_version += 1
        if not tracked.step.is_matched and tracked.index > 0:
            return  # a guessed pose must not smear the map
        if self._mapped is None or _is_far(pose, self._mapped, _MOVED, _MOVED):
            scan = deskew(tracked.scan, tracked.step.velocity) if tracked.is_deskewed else tracked.scan
            self._enter(scan, pose)
            self._mapped = pose
            if self._is_revisable:
                self._kept[_cell(pose)] = tracked.index, scan, pose

    def begin_with(self, scans: Iterable[LaserScan], poses: Pose) -> None:
        """Enter the keyframes of a saved map."""
        for scan, pose in zip(scans, poses, strict=True):
            self._enter(scan, pose)

    def path(self, start: int = 0) -> Floats:
        """Return the (n, 2) points of the path from number `start` on, metres."""
        return np.array(self._path[3 * start :]).reshape(-1, 3)[:, :2]

    @property
    def n_path(self) -> int:
        """Points of the path."""
        return len(self._path_indices)

    def places(self, pairs: Sequence[tuple[int, int]]) -> Floats:
        """Return (n, 2, 2) where the path was at n pairs of scans, metres."""
        if not pairs or not self.n_path:
            return np.zeros((0, 2, 2))
        at = np.searchsorted(np.array(self._path_indices), np.array(pairs), side="right") - 1
        return self.path()[np.maximum(at, 0)]

    def grid(self) -> OccupancyGrid:
        """Return the map so far."""
        return self._builder.grid()

    def _enter(self, scan: LaserScan, pose: Pose) -> None:
        if self.why_no_grid:
            return
        try:
            self._builder.add(scan, pose)
        except MapTooLargeError as error:
            self.why_no_grid = str(error)
        self.version += 1

    def revise(self, poses: Pose) -> None:
        """Take in revised poses, one a scan, for the next time that the map is drawn anew."""
        self._revised = poses

    def kept(self) -> list[tuple[int, LaserScan]]:
        """Return the scans that are kept, in their order, deskewed, each with its number."""
        return [(index, scan) for index, scan, _ in self._in_order()]

    def _in_order(self) -> list[tuple[int, LaserScan, Pose]]:
        return sorted(self._kept.values(), key=lambda item: item[0])

    def redraw(self) -> None:
        """Draw map and path anew with the newest revised poses, if there are any that were not used yet.

        Scans that came since stay where they were.
        """
        poses, self._revised = self._revised, None
        if poses is None or not len(poses):
            return
        with self._redraws:
            self._builder, self.why_no_grid = OccupancyBuilder(self._config), ""  # it may be small enough by now
            n, kept, self._kept = len(poses), self._in_order(), {}
            for index, scan, before in kept:
                pose = poses[index] if index < n else before
                self._enter(scan, pose)
                self._kept[_cell(pose)] = index, scan, pose
            indices, path = np.array(self._path_indices, dtype=np.int64), np.reshape(self._path, (-1, 3))
            path[indices < n] = poses[indices[indices < n]]
            self._path = array("d", path.tobytes())
            self._mapped = None
            self.path_version += 1


@dataclass(frozen=True)
class MapPicture:
    """An occupancy map as a PNG, and where it lies."""

    version: int  # rises with each change
    png: bytes  # grey and alpha; the top row has the largest y; what is unknown is transparent
    origin: tuple[float, float]  # x and y of the lower left corner, metres
    resolution: float  # side of a pixel, metres
    shape: tuple[int, int]  # rows and columns


def picture_of(grid: OccupancyGrid, version: int) -> MapPicture | None:
    """Return a map as a picture; None where it has no cells."""
    if not grid.log_odds.size:
        return None
    probability = grid.probability[::-1]
    pixels = np.empty((*probability.shape, 2), dtype=np.uint8)
    low, high = grid.config.lowest, grid.config.highest
    pixels[..., 0] = np.rint(_DARK + (255.0 - _DARK) * (high - probability) / (high - low))
    pixels[..., 1] = np.where(grid.log_odds[::-1] == 0.0, 0, 255)
    x, y = grid.origin.tolist()
    n_rows, n_columns = probability.shape
    file = BytesIO()
    Image.fromarray(pixels).save(file, "png", compress_level=1)
    return MapPicture(version, file.getvalue(), (x, y), grid.resolution, (n_rows, n_columns))


def map_file(slam_map: SlamMap) -> bytes:
    """Return a map as the bytes of its file."""
    with tempfile.TemporaryDirectory() as folder:
        slam_map.save(path := Path(folder) / "map.csmap")
        return path.read_bytes()


def _cell(pose: Pose) -> tuple[int, int, int]:
    """Return the square and the sector that a pose lies in."""
    x, y, theta = pose.tolist()
    return (math.floor(x / _KEPT_M), math.floor(y / _KEPT_M), math.floor(theta / _KEPT_RAD))


def _is_far(pose: Pose, other: Pose, metres: float, radians: float) -> bool:
    dx, dy = pose[:2] - other[:2]
    return bool(np.hypot(dx, dy) >= metres or abs(se2.wrap(pose[2] - other[2])) >= radians)


_N_SCANS = 20

_SENSOR = replace(SENSORS["spinning-360"], time_increment=1e-4)  # whose sweeps take time


def warm_up(new_engine: Callable[[], Engine], method: str = DEFAULT_METHOD) -> None:
    """Compile every kernel from a scan to a map before a source is opened, so that no scan waits."""
    with watch.held():
        curvescan.warm_up(method)
        # what is no kernel takes its time too when it is called first: a short drive with a leap
        scans = list(simulate("office", sensor=_SENSOR, n_scans=_N_SCANS, drive=Drive(path="home")))
        tracker, picture = Tracker(new_engine()), LiveMap(is_revisable=True)
        for scan in (*scans, *scans[:3]):
            picture.add(tracker.add(scan))
        picture.redraw()
        picture_of(picture.grid(), 0)
