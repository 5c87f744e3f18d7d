"""The matcher "cfsma": the paper's three stages in its order."""

from curvescan.matchers.cfsma.alignment import align, consistent_pairs
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.cfsma.features import CfSmaFeatures, extract_features
from curvescan.matchers.cfsma.functions import pair_longest
from curvescan.matchers.cfsma.landmarks import Verdict, matched_readings, pair_landmarks
from curvescan.matchers.cfsma.trace import CfSmaTrace, labels_of
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Pose


class CfSmaMatcher:
    """CF-SMA as the paper prints it: no guess, no iteration, one pass through its stages."""

    def __init__(self, config: CfSmaConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> CfSmaFeatures:
        """Return the segments, curvature functions, spectra and characteristic points of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: CfSmaFeatures) -> bool:
        """Return whether the scan has a segment at all."""
        return len(features.starts) > 0

    def match(self, reference: CfSmaFeatures, current: CfSmaFeatures, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`; the prior is not used."""
        config = self.config
        function_pairs, correlation = pair_longest(
            current.spectra,
            current.stops - current.starts,
            reference.spectra,
            reference.stops - reference.starts,
            config.functions,
        )
        landmark_pairs = pair_landmarks(
            current.points, current.landmarks, reference.points, reference.landmarks, function_pairs, config.landmarks
        )
        if config.consistency:
            landmark_pairs = consistent_pairs(
                current.points,
                current.landmarks,
                reference.points,
                reference.landmarks,
                landmark_pairs,
                config.landmarks,
                config.consistency_distance,
            )
        cur_idx, ref_idx = matched_readings(current.landmarks, reference.landmarks, landmark_pairs, config.landmarks)
        trace = CfSmaTrace(
            reference=reference,
            current=current,
            function_pairs=function_pairs,
            correlation=correlation,
            landmark_pairs=landmark_pairs,
            reading_pairs=(cur_idx, ref_idx),
        )
        outcome = _outcome(trace)
        if outcome is not Outcome.MATCHED:
            return _result(outcome, trace)
        points_cur, points_ref = current.points[cur_idx], reference.points[ref_idx]
        alignment = align(points_ref, points_cur)
        if not alignment.fixes_rotation:
            return _result(Outcome.DEGENERATE, trace)
        covariance = pose_covariance(points_cur, alignment.pose, alignment.error)
        return _result(outcome, trace, alignment.pose, covariance)


def _result(outcome: Outcome, trace: CfSmaTrace, pose: Pose = NO_POSE, covariance: Cov = NO_COVARIANCE) -> MatchResult:
    cur_idx, ref_idx = trace.reading_pairs
    n_matched = cur_idx.size if outcome is Outcome.MATCHED else 0
    return MatchResult(
        method="cfsma",
        outcome=outcome,
        pose=pose,
        covariance=covariance,
        n_matched=n_matched,
        trace=trace,
        labels_reference=labels_of(trace.reference.n_beams, trace.reference.beam_idx, ref_idx[:n_matched]),
        labels_current=labels_of(trace.current.n_beams, trace.current.beam_idx, cur_idx[:n_matched]),
    )


def _outcome(trace: CfSmaTrace) -> Outcome:
    """Return MATCHED, or which of the paper's gates left nothing."""
    if len(trace.reference.starts) == 0 or len(trace.current.starts) == 0:
        return Outcome.NO_SEGMENTS
    if trace.function_pairs[0].size == 0:
        return Outcome.NO_COMMON_FUNCTION
    furthest = trace.landmark_pairs.verdict.max(initial=Verdict.NO_CANDIDATE)
    if furthest == Verdict.NO_CANDIDATE:
        return Outcome.NO_LANDMARKS
    if furthest == Verdict.WEAK:
        return Outcome.DISSIMILAR_LANDMARKS
    if furthest < Verdict.PAIRED:
        return Outcome.AMBIGUOUS_LANDMARKS
    return Outcome.MATCHED
