"""Viewer: a sink that draws map and path in a thread of its own, for any number of browsers.

A browser is given what it has not seen: its own number of path points, the map's version, the newest scan. Nothing is
kept for it, so a slow one misses scans, never a piece of the path, and holds up nobody. What it has missed is sent
anew.
"""

from __future__ import annotations

import contextlib
import json
import math
import threading
import time
from array import array
from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, MapTooLargeError, require
from curvescan.live.live_map import MapPicture, map_file, picture_of, status_of
from curvescan.live.server import Content, Event
from curvescan.live.sinks import MapOptions, MapSink
from curvescan.live.sources import Paced
from curvescan.live.tracker import Pace, TrackedScan, Tracker
from curvescan.mapping.occupancy import OccupancyBuilder
from curvescan.scan import LaserScan
from curvescan.slam import Slam
from curvescan.types import Floats, Pose

_SEND_PERIOD = 0.025  # least time between two scans sent to a browser, seconds

_HEARTBEAT = 5.0
"""A browser to which nothing was sent for so long gets a comment, seconds: that shows whether it is still there."""

_MAX_CLOSURES = 1000  # loop closures that are drawn at most: the newest
_N_TIMES = 120  # times of scans that a new browser is sent: as many as the page draws
_N_POINTS = 1500  # readings of a scan that are sent at most
_MAX_EARLIER = 4000  # scans of a replay that can be looked at again, the older the sparser


class Viewer(MapSink):
    """What the page shows; `replay` is a source that it may pause and hurry on, the rest as of a MapSink."""

    def __init__(self, name: str, *, replay: Paced | None = None, **options: Unpack[MapOptions]) -> None:
        mode = options.get("mode", "odometry")
        self._about = {"name": name, "mode": mode, "replay": replay is not None}
        self._replay = replay
        self._tracker: Tracker | None = None
        self.actions = frozenset({"save"} if replay is None else {"save", "pace", "earlier"})
        self._earlier: list[tuple[int, bytes]] = []  # number and event of scans as they were tracked
        self._wheels = array("d")  # x, y of each scan by the wheels, one after the other, metres
        self._wheels_from: Pose | None = None
        self._status = {"kind": "loading", "text": "loading"}
        self._occupancy = options.get("occupancy")
        self._picture: MapPicture | None = None
        self._pictures = Pace(0.4, 0.1)
        self._closures: deque[tuple[int, int]] = deque(maxlen=_MAX_CLOSURES)
        self._n_closures = 0
        self._recent: deque[float] = deque(maxlen=200)
        self._times: tuple[float, ...] = ()
        self._stamps: deque[float] = deque(maxlen=50)
        self._length_m = 0.0
        self._last_pose: tuple[float, float] | None = None
        self._n_lost = 0
        self._scan_event: dict[str, Any] | None = None
        self._n_events = 0
        self._changed = threading.Condition()
        self._is_over = False
        super().__init__("viewer", **options)
        if options.get("saved_map") is not None:
            self._draw()  # no scan has come yet: the thread has nothing to draw

    page = "page"

    def offer(self, tracker: Tracker) -> None:
        """Let the page save the map that a tracker makes."""
        self._tracker = tracker

    def set_status(self, kind: str, text: str) -> None:
        """Show a sentence on the page: "loading", "running", "ended" or "error"."""
        with self._telling():
            self._status = {"kind": kind, "text": text}

    def preview(self, scan: LaserScan) -> None:
        """Show the map of the first scan alone: what there is to look at while kernels compile."""
        builder = OccupancyBuilder(self._occupancy)
        with contextlib.suppress(MapTooLargeError):  # said when the run begins
            builder.add(scan, np.zeros(3))
            self._show(picture_of(builder.grid(), version=0))

    def content(self, path: str) -> Content | None:
        """Return the newest picture of the map, once there is one."""
        picture = self._picture
        return (picture.png, "image/png") if path == "/map.png" and picture is not None else None

    def act(self, name: str, arguments: Mapping[str, Any]) -> Content:
        """Do what the page asks for: save the map, change the pace of a replay, or show an earlier scan of it."""
        if name == "save":
            return self._saved(), "application/zip"
        source = self._replay
        if name not in self.actions or source is None:
            raise InvalidArgumentError(f"the page may not ask for {name}")
        speed, is_paused, to = (arguments.get(key) for key in ("speed", "is_paused", "to"))
        if to is not None:
            require(type(to) is int and 0 <= to < 1 << 53, "to must be the number of a scan", to)
        if name == "earlier":
            require(to is not None and bool(earlier := self._earlier), "an earlier scan must have been tracked", to)
            return earlier[max(bisect_right(earlier, to, key=lambda one: one[0]) - 1, 0)][1], "application/json"
        if speed is not None:
            require(isinstance(speed, int | float) and math.isfinite(speed), "speed must be a finite number", speed)
            source.speed = float(speed)
        if is_paused is not None:
            require(isinstance(is_paused, bool), "is_paused must be true or false", is_paused)
            source.is_paused = is_paused
        if to is not None:
            source.skip_to = to
        return json.dumps({"speed": source.speed, "is_paused": source.is_paused}).encode(), "application/json"

    def _saved(self) -> bytes:
        """Return the map that SLAM has made so far as the bytes of its file."""
        if self._tracker is None or not isinstance(engine := self._tracker.engine, Slam):
            raise InvalidArgumentError("there is no map to save: SLAM makes one, once it has begun")
        with self._tracker.lock:
            slam_map = engine.map
        return map_file(slam_map)

    def stop(self) -> None:
        """End the streams of all browsers."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def events(self) -> Iterator[Event | None]:
        """Yield what a new browser has to be sent, from the beginning; None when there is nothing to send.

        The path and the map come first, then scans as they come, the newest when the browser is slower.
        """
        seen = _Seen()
        replay, now = self._replay, {}
        if replay is not None:
            now = {"pace": {"speed": replay.speed, "is_paused": replay.is_paused}, "n_scans": replay.n_scans}
        yield "about", self._about | now
        while True:
            with self._changed:
                is_new = self._changed.wait_for(lambda: self._is_over or self._n_events != seen.n_events, _HEARTBEAT)
                if self._is_over and self._n_events == seen.n_events:
                    return
                batch = list(self._unseen(seen)) if is_new else []
                # the event itself is made once and never changed: it is sent outside the lock
            if not batch:
                yield None
            yield from batch
            time.sleep(_SEND_PERIOD)

    def _unseen(self, seen: _Seen) -> Iterator[Event]:
        """Yield what is new for a browser, and mark it as seen; under the lock."""
        seen.n_events = self._n_events
        if self._status is not seen.status:
            seen.status = self._status
            yield "status", self._status
        if seen.path_version != self._map.path_version:
            seen.path_version, seen.n_path = self._map.path_version, 0
        if seen.n_path < self._map.n_path or seen.n_path == 0:
            points = self._map.path(seen.n_path)
            yield ("path", {"start": seen.n_path, "points": np.round(points, 3).ravel().tolist()})
            seen.n_path += len(points)
        if (p := self._picture) is not None and p.version != seen.picture:
            seen.picture = p.version
            yield ("map", {"version": p.version, "origin": p.origin, "resolution": p.resolution, "shape": p.shape})
        if seen.n_wheels < len(self._wheels):
            yield "wheels", {"start": seen.n_wheels // 2, "points": self._wheels[seen.n_wheels :].tolist()}
            seen.n_wheels = len(self._wheels)
        if (closures := (self._map.path_version, self._n_closures)) != seen.closures:
            seen.closures = closures
            # x, y of both ends of each on the path, metres
            yield "closures", {"lines": np.round(self._map.places(self._closures), 3).ravel().tolist()}
        if self._scan_event is not None and self._scan_event is not seen.scan_event:
            if seen.scan_event is None:  # the last one of them comes with the scan
                yield "times", {"ms": [round(ms, 3) for ms in self._times[-_N_TIMES:-1]]}
            seen.scan_event = self._scan_event
            yield "scan", self._scan_event

    def _take(self, tracked: TrackedScan) -> None:
        event = self._scan_event_of(tracked)
        if self._replay is not None:
            self._earlier = self._earlier[:: 1 + (len(self._earlier) >= _MAX_EARLIER)]
            self._earlier.append((tracked.index, json.dumps(event).encode()))
        before = self._map.why_no_grid
        with self._telling():
            self._map.add(tracked)
            self._add_wheels(tracked)
            self._closures += tracked.closures
            self._n_closures += len(tracked.closures)
            self._scan_event, self._times = event, tuple(self._recent)
        if (why := self._map.why_no_grid) != before:
            self.set_status("running", f"The map grows no more: {why}." if why else "running")
        if self._pictures.is_due:
            self._draw()

    def _add_wheels(self, tracked: TrackedScan) -> None:
        """Take up where the wheels alone have the sensor, laid on its path at the first scan that is known."""
        if tracked.wheels is None or not np.isfinite([tracked.step.pose, tracked.wheels]).all():
            return  # a gyroscope alone says nothing of the place
        if self._wheels_from is None:
            self._wheels_from = se2.compose(tracked.step.pose, se2.inverse(tracked.wheels))
        self._wheels.extend(np.round(se2.compose(self._wheels_from, tracked.wheels)[:2], 3))

    def _finish(self) -> None:
        with self._telling():
            super()._finish()
            if self._final is not None and self._scan_event is not None:
                # the map has moved to its final place, and the sensor with it
                pose = self._final[min(self._scan_event["index"], len(self._final) - 1)]
                now: dict[str, Any] = {"pose": [round(v, 5) for v in pose.tolist()]}
                if self._tracker is not None and isinstance(self._tracker.engine, Slam):
                    # some lost their weight on the way, others joined keyframes that have gone
                    now["n_closures"] = self._tracker.engine.count_matches()[0]
                self._scan_event = self._scan_event | now
        self._draw()

    def _draw(self) -> None:
        """Make a picture of the map; the grid belongs to this thread alone."""
        version = self._map.version
        with self._pictures:
            if self._picture is None or self._picture.version != version:
                self._show(picture_of(self._map.grid(), version))

    def _show(self, picture: MapPicture | None) -> None:
        with self._telling():
            self._picture = picture

    @contextlib.contextmanager
    def _telling(self) -> Iterator[None]:
        """Change what is shown, under the lock; then the streams of all browsers wake up."""
        with self._changed:
            yield
            self._n_events += 1
            self._changed.notify_all()

    def _scan_event_of(self, tracked: TrackedScan) -> dict[str, Any]:
        """Return what is sent of a scan."""
        is_known = bool(np.isfinite(tracked.step.pose).all())
        x, y, _ = tracked.step.pose_odom.tolist()
        if self._last_pose is not None:
            self._length_m += math.dist(self._last_pose, (x, y))
        self._last_pose = (x, y)
        self._recent.append(1e3 * tracked.seconds)
        self._stamps.append(tracked.scan.stamp)
        self._n_lost += not tracked.step.is_matched and tracked.index > 0
        match, c = tracked.step.match, tracked.step.covariance
        degenerate = match is not None and match.degenerate_direction is not None
        tone, word = status_of(tracked.step.outcome.name.lower(), is_degenerate=degenerate)
        points = tracked.scan.points[tracked.scan.valid]
        points = points[:: 1 + len(points) // _N_POINTS]
        recent: Floats = np.array(self._recent)
        steps = np.diff(np.array(self._stamps))
        steps = steps[steps > 0.0]
        return {
            "index": tracked.index,
            "pose": [round(v, 5) for v in tracked.step.pose.tolist()] if is_known else None,
            "covariance": [c[0, 0], c[0, 1], c[1, 1], c[2, 2]] if is_known else None,
            "tone": tone,
            "word": word,
            "sentence": tracked.step.outcome.value,
            "score": None if match is None or not match.ok else round(float(match.score), 3),
            "degenerate": degenerate,
            "ms": round(1e3 * tracked.seconds, 3),
            "ms_median": round(float(np.median(recent)), 3),
            "ms_max": round(float(recent.max()), 3),
            "rate": round(float(1.0 / np.median(steps)), 1) if steps.size else None,
            "n_lost": self._n_lost,
            "n_dropped": tracked.n_dropped,
            "n_closures": self._n_closures + len(tracked.closures),
            "length": round(self._length_m, 2),
            "received": tracked.received,
            # x, y of some of them, millimetres, one after the other
            "points": np.rint(1e3 * points.clip(-1e6, 1e6)).astype(np.int64).ravel().tolist(),
        }


@dataclass
class _Seen:
    """What a browser has been sent."""

    n_events: int = -1
    status: dict[str, str] | None = None
    path_version: int = -1
    n_path: int = 0
    picture: int = -1
    n_wheels: int = 0
    closures: tuple[int, int] = (0, 0)
    scan_event: dict[str, Any] | None = None
