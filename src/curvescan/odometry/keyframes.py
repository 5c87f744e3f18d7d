"""Key scans: the few scans that later ones are matched with, and how well their places are known to each other.

Each key scan was placed by a match with an earlier one, so that they form a tree, and the error between two of them is
that of the branch from one to the other, not that of the whole way from the start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from curvescan.matchers import PreparedScan
from curvescan.se2.uncertain import UncertainPose, between, compose, identity, inverse
from curvescan.types import Floats, Pose


@dataclass(eq=False, kw_only=True)
class Key:
    """One key scan.

    Attributes
    ----------
    scan : PreparedScan
        The scan, ready to be matched with.
    index : int
        Number of the scan in the stream.
    number : int
        Number of the key scan; it was placed by one of a lower number.
    world : UncertainPose
        Its sensor in the frame of the first scan.
    parent : Key or None
        The key scan it was placed by; None for the first and for those whose parents are all forgotten.
    used : int
        Number of the last scan that was matched with it.
    is_guess : bool
        Whether no match placed it.
    """

    scan: PreparedScan
    index: int
    number: int
    world: UncertainPose
    parent: Key | None
    used: int
    is_guess: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Fix:
    """Where a scan is, told from a key scan.

    Attributes
    ----------
    key : Key
        The key scan.
    seen : UncertainPose
        The scan seen from it.
    is_measured : bool
        Whether a match told all of it, with no direction left to what was expected.
    """

    key: Key
    seen: UncertainPose
    is_measured: bool = False

    @property
    def world(self) -> UncertainPose:
        """The scan in the frame of the first one."""
        return compose(self.key.world, self.seen)

    def moved(self, motion: UncertainPose) -> Fix:
        """Return where a motion leads from here."""
        return Fix(key=self.key, seen=compose(self.seen, motion))

    def seen_from(self, key: Key) -> UncertainPose:
        """Return the same place seen from another key scan, as well as the tree of key scans tells."""
        if key is self.key:
            return self.seen
        origin = _common_ancestor(key, self.key)
        to_key, to_here = key.world, self.world
        if origin is not None:
            to_key, to_here = between(origin.world, to_key), between(origin.world, to_here)
        return compose(inverse(to_key), to_here)


class Keys:
    """The key scans in memory, at most `max_keys`: beyond it the one not used for longest is forgotten.

    Parameters
    ----------
    max_keys : int
        At least 1.
    kept : float
        Share of the variance of a match that stays when the scan becomes a key scan, in (0, 1]. Its noise moved it one
        way in that match and moves what is matched with it the other way: along the chain much of it cancels.
    """

    def __init__(self, max_keys: int, kept: float) -> None:
        self._max_keys = max_keys
        self._kept = kept
        self._keys: list[Key] = []
        self._poses: Floats = np.empty((0, 3))
        self._n_made = 0

    def __len__(self) -> int:
        return len(self._keys)

    def __iter__(self) -> Iterator[Key]:
        return iter(self._keys)

    def add(
        self, scan: PreparedScan, index: int, fix: Fix | None, *, is_guess: bool = False
    ) -> Key:
        """Return a new key scan at a place told from an earlier one; None for the first, at the origin.

        Parameters
        ----------
        scan : PreparedScan
            The scan.
        index : int
            Its number in the stream.
        fix : Fix or None
            Where it is.
        is_guess : bool
            Whether no match says so.
        """
        key = Key(
            scan=scan,
            index=index,
            number=self._n_made,
            world=identity() if fix is None else self._place(fix),
            parent=None if fix is None else fix.key,
            used=index,
            is_guess=is_guess,
        )
        self._n_made += 1
        self._keys.append(key)
        if len(self._keys) > self._max_keys:
            self.forget(min(self._keys[:-1], key=lambda k: k.used))
        else:
            self._poses = np.concatenate((self._poses, key.world.pose[np.newaxis]))
        return key

    def nearest(self, pose: Pose, reach: float, turn: float) -> list[Key]:
        """Return the key scans around a pose, nearest first.

        Parameters
        ----------
        pose : (3,) float64
            In the frame of the first scan.
        reach, turn : float
            Greatest distance and greatest difference of direction, metres and radians, > 0.
        """
        apart = self._poses - pose
        distance = np.hypot(apart[:, 0], apart[:, 1]) / reach
        angle = np.abs(np.remainder(apart[:, 2] + np.pi, 2.0 * np.pi) - np.pi) / turn
        near = np.flatnonzero((distance <= 1.0) & (angle <= 1.0))
        order = np.argsort(distance[near] + angle[near], kind="stable")
        return [self._keys[k] for k in near[order].tolist()]

    def forget(self, lost: Key) -> None:
        """Drop a key scan; those it placed count as placed by its parent, their covariances stay."""
        self._keys.remove(lost)
        for key in self._keys:
            if key.parent is lost:
                key.parent = lost.parent
        self._poses = np.array([key.world.pose for key in self._keys]).reshape(-1, 3)

    def _place(self, fix: Fix) -> UncertainPose:
        kept = self._kept if fix.is_measured else 1.0
        return compose(fix.key.world, UncertainPose(fix.seen.pose, kept * fix.seen.cov))


def _common_ancestor(one: Key | None, other: Key | None) -> Key | None:
    """Return the last key scan that both were placed by, directly or through others."""
    while one is not other:
        # a key scan is younger than its parent: the younger of the two can't be the other's ancestor
        if other is None or (one is not None and one.number > other.number):
            one = one.parent if one is not None else None
        else:
            other = other.parent
    return one
