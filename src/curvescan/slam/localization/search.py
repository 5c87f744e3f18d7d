"""Search: where in a map the sensor may be, over the scans since it began to look.

Each view brings poses at which its scan ends on walls, and earlier ones carried on by the odometry. "Not in the map" is
one of the places: it ends on walls about as well as any other place, and a pose gathers support by how much better its
view agrees with the map. One view is enough where it leaves next to nothing open and no other place comes near, or
where it stands out. Else several must add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.localization.correlative import (
    STEP_M,
    contour_length,
    is_same,
    likely_poses,
    refined_poses,
    thinned,
)
from curvescan.slam.localization.field import DistanceField
from curvescan.slam.localization.matching import Hit
from curvescan.slam.localization.prior import LOG_ODDS, Prior
from curvescan.types import Floats, Ints, Points, Pose

_N_PLACES = 20_000
"""Places that are tried for a scan, at most; in larger maps those near the keyframes most like it."""

_N_LIKELY = 4
"""So many times more poses are looked at by their walls than are followed."""

_NEUTRAL = 0.6
"""Agreement, in [-1, 1], with the map of a sensor that is not in it; from here on a view speaks for a pose. A view that
agrees with a place by more than this, and leads all others so far that both make twice as much, is enough alone: of
1,300 scans of Intel and ACES none agrees with a wrong place so that keyframes confirm it and both make over 1.14."""

_MOST_AGAINST = 0.15
"""The most that one view says against a pose: people and things that were moved are not in the map either."""

_CONTOUR_M = 10.0
"""A view of a shorter contour says less, in proportion, metres: three sides of a booth fit in many places."""

_ONE_VIEW, _EXPLAINED = 0.3, 0.2
"""Support that one view alone needs: 90 of 100 readings end on walls and none elsewhere in the map; 80 where matches
say the same."""

_SEVERAL_VIEWS = 1.0
"""Support that several views need together."""

_MATCHED, _RIVAL = 0.5, 0.3
"""What matches without a guess say of a place that they know, and the most that they say then of any other, as a share
of it: in a row of rooms that are alike they say something of several."""

_CHANGED = 1.1
"""What they say of a place together where the map has changed."""

_LEAST = 0.4
"""Support that it needs then: the views may speak against it, and not outweigh the matches."""

_MARGIN, _MARGIN_SHARE = 0.1, 0.25
"""The support of any other place is less by so much, and by so large a share: of views that say the same of two places
more do not help."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Place:
    """A pose of the sensor that the scans so far speak for."""

    pose: Pose  # (3,): in the map
    fit: float  # how well the map agrees with the last view there, in [-2, 1]
    view: float  # by the last view alone
    support: float  # sum over the views, with what matches say
    matched: float = 0.0  # what matches without a guess say of it
    prior: float = 0.0  # what was known before says of it, where the sensor is now

    @property
    def walls(self) -> float:
        """Of the support what the views say without matches."""
        return self.support - self.matched

    @property
    def sums(self) -> tuple[float, float, float]:
        """What the last view, the views without matches, and all say, each with the prior."""
        return self.view + self.prior, self.walls + self.prior, self.support + self.prior


@dataclass(frozen=True, eq=False, kw_only=True)
class Views:
    """What the views so far say of places in a map."""

    found: Sequence[Place]  # the likeliest first
    contour: float  # length of the last view, metres

    @property
    def winner(self) -> Place | None:
        """The place for which the last view, or all views together, speak clearly more than for any other."""
        best = self._decided(self.found)
        if best is not None:
            return best
        # the views alone may decide for a place that was likely before, be another one somewhat likelier
        alone = [replace(place, prior=0.0) for place in self.found]
        best = self._decided(alone)
        return best if best is not None and self.found[alone.index(best)].prior > 0.0 else None

    def is_best(self, pose: Pose, fit: float) -> bool:
        """Return whether the map, and the prior, agree with a pose clearly better than with any other found."""
        others = [place.fit + place.prior for place in self.found if not is_same(place.pose, pose)]
        return fit >= max(others, default=-1.0) + _MARGIN

    def _decided(self, found: Sequence[Place]) -> Place | None:
        likeliest = [max(found, key=lambda place: place.sums[of], default=None) for of in (0, 2)]
        return next((best for best in likeliest if best is not None and self._is_clear(best, found)), None)

    def _is_clear(self, best: Place, found: Sequence[Place]) -> bool:
        """Return whether the last view, or all together, speak for a place clearly more than for any other."""
        others = [place for place in found if not is_same(place.pose, best.pose)]
        rival = max((place.matched for place in others), default=0.0)
        is_alone = rival <= _RIVAL * best.matched
        # a view that agrees with a match needs to say less; nor may the views before speak against it
        least = _EXPLAINED if is_alone and best.matched >= _MATCHED else _ONE_VIEW
        view, walls, support = best.sums
        is_seen = _is_clear(view, [place.sums[0] for place in others], least)
        is_seen |= rival <= best.matched and self._stands_out(best, others)
        # where the view is against all places that were expected, what was known before does not choose between them
        is_vague = best.view < 0.0 and any(place.prior > 0.0 and place.view >= best.view for place in others)
        if is_seen and best.walls >= best.view - _MARGIN and not is_vague:
            return True
        # where the sensor leaves the map, views before it did speak for places that the last one is against
        is_gathered = _is_clear(walls, [place.sums[1] for place in others], _SEVERAL_VIEWS)
        if is_gathered and best.view >= 0.0:
            return True
        # where much has changed since the map was made, matches and the lack of any other place decide;
        # but not between two places whose walls explain the views alike
        is_tied = any(place.view >= _EXPLAINED and place.sums[1] > walls - _MARGIN for place in others)
        most = max((place.sums[2] for place in others), default=-1.0)
        is_changed = best.matched >= _CHANGED and support > max(most, _LEAST)
        return is_changed and is_alone and not is_tied

    def _stands_out(self, best: Place, others: Sequence[Place]) -> bool:
        """Return whether the last view agrees with a place well, and far better than with any other."""
        fit = best.fit + best.prior
        ahead = fit - max((place.fit + place.prior for place in others), default=-1.0)
        is_ahead = ahead >= _MARGIN and fit + ahead >= 2.0 * _NEUTRAL
        return self.contour >= _CONTOUR_M and fit >= _NEUTRAL and is_ahead


class MapSearch:
    """Looks for a sensor in a map.

    keyframes (n, 3); n_tried: Places that are followed.
    """

    def __init__(self, field: DistanceField, keyframes: Pose, n_tried: int) -> None:
        from scipy.spatial import cKDTree  # loads for a good part of a second

        self.field = field
        self._n_tried = n_tried
        self._places = field.places(STEP_M, clearance=0.5 * STEP_M)
        self._nearest: Ints = cKDTree(keyframes[:, :2]).query(self._places)[1].astype(np.int64)

    def look(
        self,
        points: Points,
        *,
        prior: Prior | None = None,
        before: tuple[Views, UncertainPose] | None = None,
        similarity: Ints | None = None,
        matched: Sequence[Hit] = (),
    ) -> Views:
        """Return what a view says of places in the map, with those before it.

        points (m, 2); prior: Where the sensor is, as far as it is known without this view; before: Earlier views, and
        the motion since; similarity (n,): Keyframes, those most like the view first, in large maps.
        """
        few, contour = thinned(points), contour_length(points)
        places = self._places if similarity is None else self._near(similarity)
        # walls alone are ended on elsewhere as well: of more poses the free space between them chooses
        poses = likely_poses(self.field, places, few, _N_LIKELY * self._n_tried)
        if prior is not None:
            near = np.ascontiguousarray(self._places[prior.is_near(self._places)])
            poses = np.concatenate((poses, likely_poses(self.field, near, few, self._n_tried)))
        earlier: Sequence[Place] = ()
        if before is not None and before[0].found:
            earlier = before[0].found
            carried = se2.compose(np.array([place.pose for place in earlier]), before[1].pose)
            poses = np.concatenate((refined_poses(self.field, carried, few), poses))
        poses = np.concatenate((poses, *[hit.here.pose[np.newaxis] for hit in matched]))
        # a place that was not among those of earlier views agreed with them no better than the least of them
        missed = min((place.walls for place in earlier), default=0.0)
        likely = self.known(prior, poses)
        new: list[Place] = []
        for k, pose in enumerate(poses):
            if any(is_same(pose, place.pose) for place in new):
                continue
            followed = earlier[k] if k < len(earlier) else None
            fit = self.field.agreement(points, pose).score
            view = said(contour, fit)
            scores = [hit.score for hit in matched if is_same(hit.here.pose, pose)]
            by_matches = max(scores, default=0.0)
            support = view + by_matches + (followed.support if followed else missed)
            if likely[k] > 0.0:  # where it was expected, it may have come back into the map with this view
                support = max(support, view + by_matches)
            by_matches += followed.matched if followed else 0.0
            place = Place(pose=pose, fit=fit, view=view, support=support, matched=by_matches, prior=float(likely[k]))
            new.append(place)
        new.sort(key=lambda place: (-place.sums[2], -place.fit))
        return Views(found=new[: self._n_tried], contour=contour)

    def known(self, prior: Prior | None, poses: Pose) -> Floats:
        """Return (n,) how much a prior speaks for poses (n, 3), in units of agreement."""
        area = STEP_M**2 * len(self._places)
        return np.zeros(len(poses)) if prior is None else prior.log_odds(poses, area) / LOG_ODDS

    @property
    def is_large(self) -> bool:
        """Whether the map has too many places to try all."""
        return len(self._places) > _N_PLACES

    def _near(self, similarity: Ints) -> Points:
        rank = np.empty(len(similarity), dtype=np.int64)
        rank[similarity] = np.arange(len(similarity))
        order = np.argsort(rank[self._nearest], kind="stable")[:_N_PLACES]
        return np.ascontiguousarray(self._places[order])


def said(contour: float, fit: float) -> float:
    """Return how much a scan speaks for a pose by its contour, metres, and by how well the map agrees there."""
    return min(contour / _CONTOUR_M, 1.0) * max(fit - _NEUTRAL, -_MOST_AGAINST)


def _is_clear(best: float, others: list[float], least: float) -> bool:
    """Return whether a support is enough and clearly more than that of any other place."""
    margin = max(_MARGIN, _MARGIN_SHARE * best)
    return best >= least and best - max(others, default=-1.0) >= margin
