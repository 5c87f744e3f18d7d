"""Search: where in a map the sensor may be, over the scans since it began to look.

Each view brings poses at which its scan ends on walls, and earlier ones carried on by the odometry. "Not in the map" is
one of the places: it ends on walls about as well as any other place, and a pose gathers support by how much better its
view agrees with the map. A view, or several together, choose a place by one rule: what they say of it, and how far it
is ahead of any other, must be enough. Several must say more, as views along a corridor err alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import STEP_M, contour_length, is_same, likely_poses, refined, thinned
from curvescan.slam.localization.field import DistanceField, lasting_points
from curvescan.slam.localization.matching import N_TRIED, SCORE, SEARCHED, Hit
from curvescan.slam.localization.prior import LOG_ODDS, Prior
from curvescan.types import Floats, Ints, Points, Pose

_N_PLACES = 20_000
"""Places that are tried for a scan, at most; in larger maps those near the keyframes most like it."""

_N_LIKELY = 4
"""So many times more poses are looked at by their walls than are followed."""

_NEUTRAL = 0.6
"""Agreement, in [-1, 1], with the map of a sensor that is not in it; from here on a view speaks for a pose."""

_MOST_AGAINST = 0.15
"""The most that one view says against a pose: people and things that were moved are not in the map either."""

_CONTOUR_M = 10.0
"""A view of a shorter contour says less, in proportion, metres: three sides of a booth fit in many places."""

_ONE_VIEW, _SEVERAL_VIEWS = 1.0, 3.5
"""Needed of one view, and of all together, with one more for each view that fits nowhere: twice what they say of a
place, and how much less of any other. Of 7,000 scans and 160 starts: docs/design-notes/localization.md."""

_MARGIN = 0.1
"""They say so much less, at least, of any other place."""


class Said(NamedTuple):
    """How much views speak for a place."""

    by_all: float  # with what a match says
    by_walls: float


class Place(NamedTuple):
    """A pose of the sensor that the scans so far speak for."""

    pose: Pose  # (3,): in the map
    view: Said  # by the last view
    support: Said  # the sum over the views
    prior: float = 0.0  # what was known before says of it, where the sensor is now


class Views(NamedTuple):
    """What the views so far say of places in a map."""

    found: Sequence[Place]  # the likeliest first, none the same
    n_nowhere: int = 0  # views that speak for no place: the sensor was outside the map, or the map has changed

    @property
    def winner(self) -> Place | None:
        """The place for which the last view, or all views together, speak clearly more than for any other."""
        best = _chosen(self.found, [place.view for place in self.found], _ONE_VIEW)
        # nor do views before speak against it
        if best is not None and best.support.by_walls >= best.view.by_walls - _MARGIN:
            return best
        needed = _SEVERAL_VIEWS + self.n_nowhere  # outside the map a corridor looks like one inside for long
        best = _chosen(self.found, [place.support for place in self.found], needed)
        # a corridor repeats over many views: they do not outweigh where the sensor was and how it has moved since;
        # and where it leaves the map, views before it did speak for places that the last one is against
        return best if best is not None and best.prior > -0.5 * _MARGIN and best.view.by_walls >= 0.0 else None

    def is_best(self, pose: Pose, view: float) -> bool:
        """Return whether a view, and the prior, speak clearly more for a pose than for any other place found."""
        others = [place.view.by_walls + place.prior for place in self.found if not is_same(place.pose, pose)]
        return view >= max(others, default=-1.0) + _MARGIN


class MapSearch:
    """Looks for a sensor in a map; poses (n, 3) of the keyframes."""

    def __init__(self, field: DistanceField, poses: Pose, keyframes: Keyframes) -> None:
        from scipy.spatial import cKDTree  # loads for a good part of a second

        self.field = field
        self._keyframes = keyframes
        self._places = field.places(STEP_M, clearance=0.5 * STEP_M)
        self._nearest: Ints = cKDTree(poses[:, :2]).query(self._places)[1].astype(np.int64)

    def look(
        self,
        scan: LaserScan,
        *,
        prior: Prior | None = None,
        before: tuple[Views, UncertainPose] | None = None,
        matched: Sequence[Hit] = (),
    ) -> Views:
        """Return what a scan says of places in the map, with those before it.

        prior: Where the sensor is, as far as it is known without this view; before: Earlier views, and the motion
        since; matched: Of the scan, without a guess.
        """
        points = lasting_points(scan)
        few, contour = thinned(points), contour_length(points)
        # walls alone are ended on elsewhere as well: of more poses the free space between them chooses
        poses = likely_poses(self.field, self._places_like(scan), few, _N_LIKELY * N_TRIED)
        if prior is not None:
            near = np.ascontiguousarray(self._places[prior.is_near(self._places)])
            poses = np.concatenate((poses, likely_poses(self.field, near, few, N_TRIED)))
        past, supports = before[0] if before is not None else Views(found=()), np.empty((0, 2))
        if before is not None and past.found:
            carried, supports = self._carried(past, before[1], points, few)
            poses = np.concatenate((carried, poses))
        poses = np.concatenate((poses, *[hit.here.pose[np.newaxis] for hit in matched]))
        # a place that was not among those of earlier views agreed with them no better than the least of them
        missed = supports.min(axis=0) if len(supports) else np.zeros(2)
        new: list[Place] = []
        for k, (pose, likely) in enumerate(zip(poses, self.known(prior, poses).tolist(), strict=True)):
            if new and is_same(pose, np.array([place.pose for place in new])).any():
                continue
            # a match with a keyframe tells more than the walls of a map that is bent, or has changed
            score = max((hit.score for hit in matched if is_same(hit.here.pose, pose)), default=0.0)
            view = said(contour, self.field.agreement(points, pose), score)
            # the sensor may have come into the map with the view before, where it was expected also with this one
            least = 0.0 if likely > 0.0 else -_MOST_AGAINST
            so_far = supports[k] if k < len(supports) else missed
            support = np.maximum(view, -_MOST_AGAINST) + np.maximum(so_far, least)
            new.append(Place(pose=pose, view=view, support=Said(*support.tolist()), prior=likely))
        new.sort(key=lambda place: (-(place.support.by_all + place.prior), -place.view.by_walls))
        is_nowhere = max((place.view.by_walls for place in new), default=-1.0) < _MARGIN
        return Views(found=new[:N_TRIED], n_nowhere=past.n_nowhere + is_nowhere)

    def _carried(self, views: Views, motion: UncertainPose, points: Points, few: Points) -> tuple[Pose, Floats]:
        """Return (n, 3) earlier places moved on, or the best nearby if worth the slide; and their (n, 2) supports."""
        expected = se2.compose(np.array([place.pose for place in views.found]), motion.pose)
        best = refined(self.field, expected, few)[0]
        off, cov = se2.between(expected, best), motion.covariance + SEARCHED
        cost = np.einsum("ni,ij,nj->n", off, np.linalg.inv(cov), off)[:, np.newaxis] / (2.0 * LOG_ODDS)
        fits = np.array([[self.field.agreement(points, pose) for pose in poses] for poses in (expected, best)])
        slides = (fits[1] - fits[0])[:, np.newaxis] > cost
        supports = np.array([place.support for place in views.found]) - np.where(slides, cost, 0.0)
        return np.where(slides, best, expected), supports

    def known(self, prior: Prior | None, poses: Pose) -> Floats:
        """Return (n,) how much a prior speaks for poses (n, 3), in units of agreement."""
        area = STEP_M**2 * len(self._places)
        return np.zeros(len(poses)) if prior is None else prior.log_odds(poses, area) / LOG_ODDS

    def _places_like(self, scan: LaserScan) -> Points:
        """Return all places; of a large map those near the keyframes most like a scan."""
        if len(self._places) <= _N_PLACES:
            return self._places
        keyframes = self._keyframes
        similar = keyframes.index.most_similar(keyframes.signature(keyframes.prepare(scan)), len(keyframes))
        order = np.argsort(np.argsort(similar)[self._nearest], kind="stable")[:_N_PLACES]
        return np.ascontiguousarray(self._places[order])


def said(contour: float, fit: float, score: float = 0.0) -> Said:
    """Return how much a scan speaks for a pose, by its contour, metres, how the map agrees, and a match's score."""
    share = min(contour / _CONTOUR_M, 1.0)
    return Said(share * (fit + SCORE * score - _NEUTRAL), share * (fit - _NEUTRAL))


def _chosen(places: Sequence[Place], views: Sequence[Said], needed: float) -> Place | None:
    """Return the place of which most is said, where that, and how much less is said of any other, are enough."""
    if not places:
        return None
    rows = np.array(views) + [[place.prior] for place in places]
    best = int(np.argmax(rows[:, 0]))
    # matches do not decide between two places whose walls look alike
    most, ahead = rows[best, 0], rows[best] - np.max(np.delete(rows, best, axis=0), axis=0, initial=-1.0)
    is_clear = most >= 0.0 and ahead.min() >= _MARGIN and 2.0 * most + ahead[0] >= needed
    return places[best] if is_clear else None
