"""The matcher "curvescan": hypotheses from CF-SMA's kind of corners, verified, refined, and judged.

It starts where CF-SMA starts, from the characteristic points of surfaces, and closes its two holes. A corner with the
two directions that leave it is a frame, and one pair of frames a pose, so that no single wrong pair decides; and the
pose is refined point to line, so that no index-by-index pairs cost accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan.consensus.config import ConsensusConfig
from curvescan.consensus.features import ConsensusFeatures, extract_features
from curvescan.consensus.hypotheses import most_voted, pair_frames
from curvescan.consensus.information import covariance, pose_information
from curvescan.consensus.labels import compare_readings
from curvescan.consensus.refinement import refine
from curvescan.consensus.turns import lattice, slides, turns
from curvescan.consensus.verification import best_beside, select
from curvescan.matching.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.types import Bools, Codes, Floats, Pose

_STAND_STILL = np.zeros(3)
_LABELS = np.array([Label.NEW, Label.MATCHED, Label.MOVED], dtype=np.uint8)
_MIN_PROBES = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way.

    Attributes
    ----------
    reference, current : ConsensusFeatures
        Features of both scans.
    n_tried : int
        Poses verified.
    candidates : (k, 3) float64
        The best of them that differ, after a quick refinement, best first.
    scores : (k,) float64
        How well the scans agree there, at most 1.
    """

    reference: ConsensusFeatures
    current: ConsensusFeatures
    n_tried: int
    candidates: Floats
    scores: Floats


class CurvescanMatcher:
    """The default matcher: guess-free, and certain of itself or silent."""

    def __init__(self, config: ConsensusConfig) -> None:
        self.config = config
        refinement = config.refinement
        self._quick = np.array(refinement.quick)
        self._closer = np.array(refinement.closer)
        self._full = np.array(refinement.full)
        self._offsets = np.array(config.information.offsets)
        self._n_fine = round(config.hypotheses.slide_reach / config.information.fine_step)

    def prepare(self, scan: LaserScan) -> ConsensusFeatures:
        """Return the surfels, corners and polar view of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: ConsensusFeatures) -> bool:
        """Return whether the scan has surfaces to compare."""
        return len(features.view.probes) >= _MIN_PROBES

    def match(
        self, reference: ConsensusFeatures, current: ConsensusFeatures, guess: Pose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`.

        A guess is one more hypothesis. It is taken without a look at others when many readings agree there and fix
        both axes, and it decides between poses that explain the scans as well as each other.
        """
        ref, cur = reference, current
        if not (self.can_be_reference(ref) and self.can_be_reference(cur)):
            return _silence(Outcome.NO_SEGMENTS, _trace(ref, cur))
        trace = (guess is not None and self._follow(ref, cur, guess)) or self._search(
            ref, cur, guess
        )
        poses, scores = self._finalists(trace)
        if not len(poses):
            return _silence(Outcome.UNSUPPORTED, trace)
        told = _consult(ref, cur, poses[0])
        if self._is_weak(told):
            poses, scores = self._slide_finely(trace, poses, told)
            told = _consult(ref, cur, poses[0])
        preferred = self._preferred(guess, poses, scores)
        if preferred is not None:
            poses, scores = poses[preferred:][:1], scores[preferred:][:1]
            told = _consult(ref, cur, poses[0])
        is_open = self._open_directions(trace, poses, scores, told)
        nearest = self._nearest_on_the_way(guess, poses, scores, told, is_open)
        if nearest > 0:
            poses[[0, nearest]] = poses[[nearest, 0]]
            told = _consult(ref, cur, poses[0])
        outcome = self._judge(poses, scores, told, is_open)
        if outcome is not Outcome.MATCHED:
            return _silence(outcome, trace, scores)
        return MatchResult(
            method="curvescan",
            outcome=outcome,
            pose=poses[0],
            covariance=covariance(
                told.information, told.axes, told.units, is_open, self.config.information.open_sigma
            ),
            n_matched=told.n_agree,
            trace=trace,
            labels_reference=_labels(ref, told.codes_ref),
            labels_current=_labels(cur, told.codes_cur),
            weak_direction=told.weakest if is_open.any() else None,
            score=float(scores[0]),
            runner_up=_runner_up(scores),
        )

    def _follow(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose
    ) -> CurvescanTrace | None:
        """Return the guess refined, when it is trusted."""
        verification, steps = self.config.verification, self.config.hypotheses
        near = refine(guess[np.newaxis], ref.view, cur.view, self._quick)
        near, scores = select(near, ref.view, cur.view, *verification.close, 1, 64, 0.3)
        if (
            len(near)
            and scores[0] > verification.trusted_score
            and _distance(near[0], guess) < 2.0 * steps.slide_step
            and not len(slides(near, ref.view, cur.view, steps.slide_step, 1, 0.1))
        ):
            return _trace(ref, cur, 1, near, scores)
        return None

    def _search(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose | None
    ) -> CurvescanTrace:
        """Return the best poses of all that frames, turns and the guess propose."""
        config = self.config.hypotheses
        turned = turns(ref.directions, cur.directions, config.n_turns, _STAND_STILL)
        if guess is not None:
            turned = np.concatenate((guess[np.newaxis], turned))
        pairs = pair_frames(
            ref.frames, cur.frames, ref.view, cur.view, config.turn_tolerance, config.max_pairs
        )
        voted = most_voted(pairs, config.cell, 0.5 * config.cell, config.max_tried)
        tried = np.concatenate((turned, voted))
        candidates, scores = self._try(ref, cur, tried)
        n_tried = len(tried)
        if self._is_doubtful(scores, n_tried):
            reach = round(config.lattice_reach / config.lattice_step)
            dense = lattice(turned, config.lattice_step, reach)
            candidates, scores = self._try(ref, cur, np.concatenate((candidates, dense)))
            n_tried += len(dense)
        return _trace(ref, cur, n_tried, candidates, scores)

    def _is_doubtful(self, scores: Floats, n_tried: int) -> bool:
        """Return whether the best pose finds little support, or no more than middling with few or near rivals."""
        config = self.config.verification
        if not len(scores) or scores[0] < config.doubtful_score:
            return True
        is_contested = len(scores) > 1 and scores[1] > config.contested * scores[0]
        return bool(
            (is_contested and scores[0] < config.trusted_score)
            or (n_tried < config.few_tried and scores[0] < config.certain_score)
        )

    def _try(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, poses: Floats
    ) -> tuple[Floats, Floats]:
        """Return the best of many poses, refined on the probes, best first, and their scores."""
        config, steps, views = (
            self.config.verification,
            self.config.hypotheses,
            (ref.view, cur.view),
        )
        chosen, _ = select(poses, *views, *config.rough, config.n_kept, 6, 0.3)
        quick = refine(chosen, *views, self._quick)
        n_slides = round(steps.slide_reach / steps.slide_step)
        slid = slides(quick[:2], *views, steps.slide_step, n_slides, 0.1)
        if len(slid):
            every = np.concatenate((quick, slid))
            chosen, _ = select(every, *views, *config.slid, config.n_kept + 1, 12, 0.3)
            quick = refine(chosen, *views, self._quick)
        return select(quick, *views, *config.close, 3, 64, 0.3)

    def _finalists(self, trace: CurvescanTrace) -> tuple[Floats, Floats]:
        """Return the best pose, refined on all readings, and its rivals if they come near, and their scores."""
        if not len(trace.scores):
            return trace.candidates, trace.scores
        contested = self.config.verification.contested
        near = trace.candidates[trace.scores > contested * trace.scores[0]]
        return self._finish(trace, near)

    def _finish(self, trace: CurvescanTrace, poses: Floats) -> tuple[Floats, Floats]:
        """Return poses refined on all readings, those that differ, best first, and their scores."""
        ref, cur = trace.reference, trace.current
        closer = refine(poses, ref.view, cur.view, self._closer)
        final = refine(closer, ref.whole, cur.whole, self._full)
        return select(final, ref.wide, cur.wide, *self.config.verification.fine, 3, 4096, 0.2)

    def _is_weak(self, told: _Told) -> bool:
        """Return whether much less is told in one direction than in the next."""
        return bool(told.information[0] < self.config.information.weak_ratio * told.information[1])

    def _slide_finely(
        self, trace: CurvescanTrace, poses: Floats, told: _Told
    ) -> tuple[Floats, Floats]:
        """Return the poses and the best of those along their least informed direction, best first, and their scores."""
        ref, cur, config = trace.reference, trace.current, self.config
        offsets = np.arange(-self._n_fine, self._n_fine + 1) * config.information.fine_step
        slid = poses[0] + offsets[:, np.newaxis] * told.weakest
        slid = slid[np.abs(offsets * told.weakest[2]) < config.information.max_slid_turn]
        best, _ = select(slid, ref.wide, cur.wide, *config.verification.close, 4, 24, 0.1)
        return self._finish(trace, np.concatenate((poses, best)))

    def _rivals(self, scores: Floats) -> list[int]:
        """Return the numbers of the poses that are as good as the first."""
        share, margin = self.config.verification.ambiguity
        least = min(share * scores[0], scores[0] - margin)
        return [k for k in range(1, len(scores)) if scores[k] > least]

    def _preferred(self, guess: Pose | None, poses: Floats, scores: Floats) -> int | None:
        """Return which of the poses that are as good as each other the guess is clearly nearest to, if any."""
        rivals = self._rivals(scores)
        if guess is None or not rivals:
            return None
        distances = np.array([_distance(poses[k], guess) for k in [0, *rivals]])
        first, second = np.argsort(distances, kind="stable")[:2]
        if 2.0 * distances[first] > distances[second]:
            return None
        return int([0, *rivals][first])

    def _open_directions(
        self, trace: CurvescanTrace, poses: Floats, scores: Floats, told: _Told
    ) -> Bools:
        """Return which principal directions the scans leave open, (3,) the least informed first."""
        config, views = self.config.information, (trace.reference.view, trace.current.view)
        information = told.information
        is_open: Bools = (information < 2.0 * told.feigned) | (information < config.max_sigma**-2)
        if is_open[0] or not self._is_weak(told):
            return is_open
        fine = self.config.verification.fine
        here = best_beside(poses[0], told.weakest, np.zeros(1), *views, *fine)
        beside = best_beside(poses[0], told.weakest, self._offsets, *views, *fine)
        is_open[0] = beside > config.flat_score * here or any(
            _is_on_the_way(told.weakest, poses[0], poses[k], config.way_tolerance)
            for k in self._rivals(scores)
        )
        return is_open

    def _nearest_on_the_way(
        self, guess: Pose | None, poses: Floats, scores: Floats, told: _Told, is_open: Bools
    ) -> int:
        """Return which of the poses that tie along an open direction is nearest to the guess, or to standing still."""
        if not is_open[0]:
            return 0
        around = _STAND_STILL if guess is None else guess
        tolerance = self.config.information.way_tolerance
        on_the_way = [
            k
            for k in self._rivals(scores)
            if scores[k] > self.config.information.tie * scores[0]
            and _is_on_the_way(told.weakest, poses[0], poses[k], tolerance)
        ]
        return min([0, *on_the_way], key=lambda k: _distance(poses[k], around))

    def _judge(self, poses: Floats, scores: Floats, told: _Told, is_open: Bools) -> Outcome:
        """Return whether the best pose may be called the match."""
        if scores[0] < self.config.verification.min_score or is_open.all():
            return Outcome.UNSUPPORTED
        tolerance = self.config.information.way_tolerance
        for k in self._rivals(scores):
            # a rival along an open direction is no rival: the covariance says as much
            if not is_open[0] or not _is_on_the_way(told.weakest, poses[0], poses[k], tolerance):
                return Outcome.AMBIGUOUS
        return Outcome.MATCHED


@dataclass(frozen=True, eq=False, kw_only=True)
class _Told:
    """What the readings of two scans tell of a pose; see labels.py and information.py."""

    codes_ref: Codes
    codes_cur: Codes
    n_agree: int
    information: Floats
    feigned: Floats
    axes: Floats
    units: Floats

    @property
    def weakest(self) -> Pose:
        """The change of pose that moves the readings least: metres, metres, radians for a metre's worth."""
        weakest: Pose = self.axes[:, 0] * self.units
        return weakest


def _consult(ref: ConsensusFeatures, cur: ConsensusFeatures, pose: Pose) -> _Told:
    surfels_ref, surfels_cur = ref.view.surfels, cur.view.surfels
    codes_cur, partner_cur = compare_readings(surfels_cur, ref.view, pose, 0.01)
    codes_ref, partner_ref = compare_readings(surfels_ref, cur.view, _inverse(pose), 0.01)
    information, feigned, axes, units = pose_information(
        surfels_ref, partner_ref, surfels_cur, partner_cur, pose
    )
    return _Told(
        codes_ref=codes_ref,
        codes_cur=codes_cur,
        n_agree=int(np.count_nonzero(partner_cur >= 0)),
        information=information,
        feigned=feigned,
        axes=axes,
        units=units,
    )


def _trace(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    n_tried: int = 0,
    candidates: Floats | None = None,
    scores: Floats | None = None,
) -> CurvescanTrace:
    return CurvescanTrace(
        reference=ref,
        current=cur,
        n_tried=n_tried,
        candidates=np.empty((0, 3)) if candidates is None else candidates,
        scores=np.empty(0) if scores is None else scores,
    )


def _inverse(pose: Pose) -> Pose:
    # se2.inverse takes any number of poses, and ten times as long for one
    x, y, theta = pose.tolist()
    c, s = math.cos(theta), math.sin(theta)
    return np.array([-c * x - s * y, s * x - c * y, -theta])


def _difference(pose: Pose, origin: Pose) -> Pose:
    return np.array(
        [
            pose[0] - origin[0],
            pose[1] - origin[1],
            math.remainder(pose[2] - origin[2], 2.0 * math.pi),
        ]
    )


def _distance(a: Pose, b: Pose) -> float:
    """Return how far apart two poses are: metres, or radians times 2 m, whichever is more."""
    x, y, theta = _difference(a, b).tolist()
    return float(max(math.hypot(x, y), 2.0 * abs(theta)))


def _is_on_the_way(direction: Pose, pose: Pose, other: Pose, tolerance: float) -> bool:
    """Return whether a motion that starts in a direction and keeps to it, a line or an arc, passes another pose."""
    x, y, theta = _difference(other, pose).tolist()
    if abs(direction[2]) < 0.05 * math.hypot(direction[0], direction[1]):
        norm = math.hypot(direction[0], direction[1])
        across = abs(direction[0] * y - direction[1] * x) / norm
        return bool(max(across, abs(theta)) < tolerance)
    # the sensor circles around this place, seen from the pose
    cx, cy = -direction[1] / direction[2], direction[0] / direction[2]
    c, s = math.cos(theta), math.sin(theta)
    arc_x, arc_y = cx - c * cx + s * cy, cy - s * cx - c * cy
    return bool(math.hypot(x - arc_x, y - arc_y) < tolerance * (1.0 + abs(theta)))


def _runner_up(scores: Floats) -> float:
    return float(scores[1]) if len(scores) > 1 else math.nan


def _labels(features: ConsensusFeatures, codes: Codes) -> Codes:
    labels = np.zeros(features.n_beams, dtype=np.uint8)
    labels[features.beam_idx] = _LABELS[codes]
    return labels


def _silence(outcome: Outcome, trace: CurvescanTrace, scores: Floats | None = None) -> MatchResult:
    """Return a result without a pose."""
    labels = []
    for features in (trace.reference, trace.current):
        one = np.zeros(features.n_beams, dtype=np.uint8)
        one[features.beam_idx] = Label.UNMATCHED
        labels.append(one)
    return MatchResult(
        method="curvescan",
        outcome=outcome,
        pose=NO_POSE,
        covariance=NO_COVARIANCE,
        n_matched=0,
        trace=trace,
        labels_reference=labels[0],
        labels_current=labels[1],
        score=math.nan if scores is None else float(scores[0]),
        runner_up=math.nan if scores is None else _runner_up(scores),
    )
