"""Keyframes: the scans that the map is made of, compact, and prepared for matching when they are needed."""

from __future__ import annotations

import itertools
import math
from collections import OrderedDict
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from curvescan.matchers import DEFAULT_METHOD, Matcher, MatchResult, PreparedScan, find_matcher, prepare, prepared
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, Outcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.loops.overlap import N_SECTORS, range_profile
from curvescan.slam.loops.place_index import PlaceIndex, Signature, signature
from curvescan.slam.map import SlamMap
from curvescan.slam.open_direction import along_walls
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Bools, Ints, with_fields

_N_PREPARED = 100
"""Keyframes whose features are held in memory; those of others are computed again when they are needed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Keyframe:
    """One keyframe."""

    scan: LaserScan  # its scan, deskewed; ranges have the precision of float32, as in the map's file
    index: int  # number of the scan in its session
    session: int = 0  # number of the session, from 0
    number: int = 0  # number of the keyframe, which it keeps when others go


class Keyframes:
    """All keyframes, by row; `index` tells which of them look like a scan; the features of those used last are kept."""

    def __init__(self, matcher: Matcher) -> None:
        self._matcher = matcher
        self._all: list[Keyframe] = []
        self._numbers = itertools.count()
        self.profiles = Rows((2, N_SECTORS))
        self.index = PlaceIndex()
        self._prepared: OrderedDict[int, PreparedScan] = OrderedDict()

    def __len__(self) -> int:
        return len(self._all)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_prepared": OrderedDict(), "profiles": None, "index": None}  # matches need none of it

    def __getitem__(self, k: int) -> Keyframe:
        return self._all[k]

    def __iter__(self) -> Iterator[Keyframe]:
        return iter(self._all)

    def add(self, scan: LaserScan, index: int, session: int = 0) -> int:
        """Append a keyframe and return its row."""
        keyframe = Keyframe(scan=compact(scan), index=index, session=session, number=next(self._numbers))
        k = len(self._all)
        self._all.append(keyframe)
        self.profiles.append(range_profile(keyframe.scan))
        self.index.append(self.signature(self.prepared(k)))
        return k

    def add_all(self, slam_map: SlamMap) -> None:
        """Append the keyframes of a map."""
        for keyframe in zip(slam_map.scans, slam_map.indices.tolist(), slam_map.sessions.tolist(), strict=True):
            self.add(*keyframe)

    @property
    def numbers(self) -> Ints:
        """(n,) int64 number of each keyframe; they grow."""
        return np.array([keyframe.number for keyframe in self._all], dtype=np.int64)

    def keep(self, is_kept: Bools) -> None:
        """Remove the keyframes that are not kept; the others keep their order and their numbers."""
        for k in np.flatnonzero(~is_kept)[::-1].tolist():
            self._prepared.pop(self._all.pop(k).number, None)
        self.profiles.keep(is_kept)
        self.index.keep(is_kept)

    def signature(self, scan: PreparedScan) -> Signature:
        """Return the signature of a scan for the place index, from the samples of the default matcher."""
        is_default = isinstance(scan.matcher, type(find_matcher(DEFAULT_METHOD)))
        return signature((scan if is_default else prepare(scan.scan)).features.sampled_points)

    def prepared(self, k: int) -> PreparedScan:
        """Return a keyframe ready to be matched."""
        keyframe = self._all[k]
        # points and directions of a copy of the scan go with it
        found = self._prepared.pop(keyframe.number, None) or self.prepare(copy(keyframe.scan))
        self._prepared[keyframe.number] = found
        if len(self._prepared) > _N_PREPARED:
            self._prepared.popitem(last=False)
        return found

    def match(self, i: int, current: PreparedScan, prior: UncertainPose | None) -> MatchResult:
        """Return the match of a scan with keyframe i, given what is known of it before.

        One that leaves a turn open, in a round room, is none: many of them together seem to measure the turn.
        """
        reference = self.prepared(i)
        result = reference.matcher.match(reference.features, current.features, prior)
        if result.degenerate_direction is None:
            return result
        x, y, turn = result.degenerate_direction.tolist()
        seen = reference.scan.points[reference.scan.valid]
        if math.hypot(x, y) <= abs(turn) * np.median(np.hypot(*seen.T)):  # about a point among what is seen
            return with_fields(result, outcome=Outcome.UNCONSTRAINED, pose=NO_POSE, covariance=NO_COVARIANCE)
        return with_fields(result, degenerate_direction=along_walls(seen, result.degenerate_direction))

    def prepare(self, scan: LaserScan) -> PreparedScan:
        """Return any scan ready to be matched with keyframes."""
        return prepared(scan, self._matcher, "scan")


def compact(scan: LaserScan) -> LaserScan:
    """Return a scan without intensities, with ranges of the precision of float32."""
    with np.errstate(over="ignore"):
        ranges = scan.ranges.astype(np.float32).astype(np.float64)
    return replace(scan, ranges=ranges, intensities=None, time_increment=0.0, scan_time=0.0)
