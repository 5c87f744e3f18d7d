"""Keyframes: the few scans that later ones are matched with, and how well their places are known to each other.

Each keyframe was placed by a match with an earlier one, so that they form a tree, and the error between two of them is
that of the branch from one to the other, not that of the whole way from the start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from curvescan.matchers import PreparedScan
from curvescan.se2.uncertain import UncertainPose, between, compose, identity, inverse
from curvescan.types import Cov, Floats, Pose


@dataclass(eq=False, kw_only=True)
class Keyframe:
    """One keyframe.

    Attributes
    ----------
    scan : PreparedScan
        The scan, ready to be matched with.
    index : int
        Number of the scan in the stream.
    number : int
        Number of the keyframe; it was placed by one of a lower number.
    pose_map_keyframe : UncertainPose
        Its sensor in the frame of the first scan.
    parent : Keyframe or None
        The keyframe it was placed by; None for the first and for those whose parents are all forgotten.
    used : int
        Number of the last scan that was matched with it.
    is_predicted : bool
        Whether no match placed it, but the expected motion.
    """

    scan: PreparedScan
    index: int
    number: int
    pose_map_keyframe: UncertainPose
    parent: Keyframe | None
    used: int
    is_predicted: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Localization:
    """Where a scan is, relative to a keyframe.

    Attributes
    ----------
    keyframe : Keyframe
        The keyframe.
    pose_keyframe_scan : UncertainPose
        The scan seen from it.
    is_measured : bool
        Whether a match measured all of it, with no direction left to what was expected.
    """

    keyframe: Keyframe
    pose_keyframe_scan: UncertainPose
    is_measured: bool = False

    @property
    def pose_map_scan(self) -> UncertainPose:
        """The scan in the frame of the first one."""
        return compose(self.keyframe.pose_map_keyframe, self.pose_keyframe_scan)

    def moved(self, motion: UncertainPose) -> Localization:
        """Return where a motion leads from here."""
        return Localization(keyframe=self.keyframe, pose_keyframe_scan=compose(self.pose_keyframe_scan, motion))

    def relative_to(self, keyframe: Keyframe) -> UncertainPose:
        """Return the same place seen from another keyframe, through the tree of keyframes."""
        if keyframe is self.keyframe:
            return self.pose_keyframe_scan
        origin = _common_ancestor(keyframe, self.keyframe)
        to_keyframe, to_here = keyframe.pose_map_keyframe, self.pose_map_scan
        if origin is not None:
            to_keyframe, to_here = (
                between(origin.pose_map_keyframe, to_keyframe),
                between(origin.pose_map_keyframe, to_here),
            )
        return compose(inverse(to_keyframe), to_here)


class KeyframeGraph:
    """The keyframes in memory, at most `max_keyframes`: beyond it the one not used for longest is forgotten."""

    def __init__(self, max_keyframes: int, variance_retained: float) -> None:
        self._max_keyframes = max_keyframes
        self._variance_retained = variance_retained
        self._keyframes: list[Keyframe] = []
        self._poses: Floats = np.empty((0, 3))
        self._n_made = 0

    def __len__(self) -> int:
        return len(self._keyframes)

    def __iter__(self) -> Iterator[Keyframe]:
        return iter(self._keyframes)

    def add(
        self, scan: PreparedScan, index: int, localization: Localization | None, *, is_predicted: bool = False
    ) -> Keyframe:
        """Return a new keyframe, held from now on; the arguments are those of :meth:`make`."""
        keyframe = self.make(scan, index, localization, is_predicted=is_predicted)
        self.insert(keyframe)
        return keyframe

    def make(
        self, scan: PreparedScan, index: int, localization: Localization | None, *, is_predicted: bool = False
    ) -> Keyframe:
        """Return a keyframe placed by an earlier one, or at the origin, without taking it in.

        localization: Where it is; None for the origin.
        """
        parent = None if localization is None else localization.keyframe
        return Keyframe(
            scan=scan,
            index=index,
            number=self._n_made if parent is None else max(self._n_made, parent.number + 1),
            pose_map_keyframe=identity() if localization is None else self._place(localization),
            parent=parent,
            used=index,
            is_predicted=is_predicted,
        )

    def insert(self, keyframe: Keyframe) -> None:
        """Take in a keyframe; beyond the limit the one not used for longest is forgotten."""
        self._n_made = keyframe.number + 1
        self._keyframes.append(keyframe)
        if len(self._keyframes) > self._max_keyframes:
            self.forget(min(self._keyframes[:-1], key=lambda k: k.used))
        else:
            self._poses = np.concatenate((self._poses, keyframe.pose_map_keyframe.pose[np.newaxis]))

    def nearest(self, pose: Pose, reach: float, turn: float) -> list[Keyframe]:
        """Return the keyframes around a pose, nearest first.

        pose (3,).
        """
        apart = self._poses - pose
        distance = np.hypot(apart[:, 0], apart[:, 1]) / reach
        angle = np.abs(np.remainder(apart[:, 2] + np.pi, 2.0 * np.pi) - np.pi) / turn
        near = np.flatnonzero((distance <= 1.0) & (angle <= 1.0))
        order = np.argsort(distance[near] + angle[near], kind="stable")
        return [self._keyframes[k] for k in near[order].tolist()]

    def forget(self, keyframe: Keyframe) -> None:
        """Drop a keyframe; those it placed count as placed by its parent, their covariances stay."""
        self._keyframes.remove(keyframe)
        for other in self._keyframes:
            if other.parent is keyframe:
                other.parent = keyframe.parent
        self._poses = np.array([other.pose_map_keyframe.pose for other in self._keyframes]).reshape(-1, 3)

    def disconnect(self, first: int, cov: Cov) -> None:
        """Add a covariance to the places of the keyframes made from a scan on: only among each other are they known."""
        for keyframe in self._keyframes:
            if keyframe.index >= first:
                pose, known = keyframe.pose_map_keyframe
                keyframe.pose_map_keyframe = UncertainPose(pose, known + cov)

    def _place(self, localization: Localization) -> UncertainPose:
        variance_retained = self._variance_retained if localization.is_measured else 1.0
        return compose(
            localization.keyframe.pose_map_keyframe,
            UncertainPose(
                localization.pose_keyframe_scan.pose, variance_retained * localization.pose_keyframe_scan.cov
            ),
        )


def _common_ancestor(one: Keyframe | None, other: Keyframe | None) -> Keyframe | None:
    """Return the last keyframe that both were placed by, directly or through others."""
    while one is not other:
        # a keyframe is younger than its parent: the younger of the two can't be the other's ancestor
        if other is None or (one is not None and one.number > other.number):
            one = one.parent if one is not None else None
        else:
            other = other.parent
    return one
