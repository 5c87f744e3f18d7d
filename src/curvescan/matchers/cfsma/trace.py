"""What a match did, stage by stage: which gate each reading came to, and what each gate rejected.

Nothing here takes part in a pose; it is computed on access.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from curvescan.matchers.cfsma.features import CfSmaFeatures
from curvescan.matchers.cfsma.landmarks import LandmarkPairs, Verdict
from curvescan.matchers.result import Label
from curvescan.types import Codes, Floats, Ints


class Gate(IntEnum):
    """How far a reading came on its way into the pose; each gate is a parameter's."""

    NO_READING = 0
    ISOLATED = 1
    UNCORRELATED = 2
    STRAIGHT = 3
    WEAK = 4
    AMBIGUOUS = 5
    ONE_SIDED = 6
    INCONSISTENT = 7
    OUT_OF_REACH = 8
    MATCHED = 9

    @property
    def parameter(self) -> str:
        """Field of the configuration that closed the gate, with the paper's symbol; empty for none."""
        return _GATES[self][0]

    @property
    def sentence(self) -> str:
        """What the gate means for a reading."""
        return _GATES[self][1]


_GATES = {
    Gate.NO_READING: ("", "no valid reading"),
    Gate.ISOLATED: (
        "range_sigma (sigma_rho), incidence_limit (lambda), min_readings",
        "in a group of too few readings",
    ),
    Gate.UNCORRELATED: ("min_correlation (U_c)", "in a segment whose curvature function has no partner"),
    Gate.STRAIGHT: (
        "min_curvature (U_p), arc_tolerance (U_k)",
        "in a paired segment without a characteristic point, here or there",
    ),
    Gate.WEAK: ("min_similarity (S_min)", "around corners that look unlike their candidates"),
    Gate.AMBIGUOUS: ("max_ambiguity", "around corners with two candidates nearly as good"),
    Gate.ONE_SIDED: ("mutual best", "around corners whose best partner prefers another"),
    Gate.INCONSISTENT: (
        "consistency, consistency_distance",
        "around corners whose pair does not agree with the others",
    ),
    Gate.OUT_OF_REACH: ("n_neighbours (n)", "too far along from a matched corner"),
    Gate.MATCHED: ("", "matched, the pose stands on it"),
}

_GATE_OF_VERDICT = np.array(
    [Gate.STRAIGHT, Gate.WEAK, Gate.AMBIGUOUS, Gate.ONE_SIDED, Gate.INCONSISTENT, Gate.OUT_OF_REACH], dtype=np.uint8
)


def labels_of(n_beams: int, beam_idx: Ints, matched: Ints) -> Codes:
    """Return (n_beams,) a Label for each beam of a scan, of whose readings these are matched. beam_idx (m,)."""
    labels = np.full(n_beams, Label.NO_READING, dtype=np.uint8)
    labels[beam_idx] = Label.UNMATCHED
    labels[beam_idx[matched]] = Label.MATCHED
    return labels


def count_gates(gates: Codes) -> dict[str, int]:
    """Return how many readings came to each gate, by the gate's name, in the order of the stages."""
    counts = np.bincount(gates, minlength=len(Gate))
    return {gate.name.lower(): int(counts[gate]) for gate in Gate}


@dataclass(frozen=True, eq=False, kw_only=True)
class CfSmaTrace:
    """What happened between two scans, stage by stage; everything a picture or a diagnosis needs."""

    # reference, current: features of both scans
    reference: CfSmaFeatures
    current: CfSmaFeatures
    # ((p,) int64, (p,) int64): paired segments, current and reference, most alike first
    function_pairs: tuple[Ints, Ints]
    correlation: Floats  # (p,): Their correlation upsilon (eq. 6).
    landmark_pairs: LandmarkPairs  # verdict on each characteristic point of the current scan
    # ((N_t,) int64, (N_t,) int64): matched readings, current and reference, in sweep order of each scan's features
    reading_pairs: tuple[Ints, Ints]

    @cached_property
    def gates_reference(self) -> Codes:
        """(n_beams,) uint8: the Gate that each beam of the reference came to."""
        return self._gates(self.reference, self.function_pairs[1], self.reading_pairs[1])

    @cached_property
    def gates_current(self) -> Codes:
        """(n_beams,) uint8: the Gate that each beam of the current scan came to."""
        return self._gates(self.current, self.function_pairs[0], self.reading_pairs[0])

    @cached_property
    def segment_verdicts(self) -> Codes:
        """(p,) uint8: for each pair of functions, the best Verdict on a characteristic point of it."""
        bounds = self.current.landmarks.bounds
        verdict = self.landmark_pairs.verdict
        return np.array(
            [verdict[bounds[k] : bounds[k + 1]].max(initial=0) for k in self.function_pairs[0]], dtype=np.uint8
        )

    def rejections(self) -> dict[str, int]:
        """Return what each gate rejected, in the order of the stages.

        Segments for the first two of the current scan, characteristic points for the others.
        """
        verdict = self.landmark_pairs.verdict
        return {
            "isolated readings": int(np.count_nonzero(self.gates_current == Gate.ISOLATED)),
            "functions without partner (U_c)": len(self.current.starts) - len(self.function_pairs[0]),
            "function pairs without corner (U_p)": int(np.count_nonzero(self.segment_verdicts == Verdict.NO_CANDIDATE)),
            "corners unlike their candidates (S_min)": int(np.sum(verdict == Verdict.WEAK)),
            "corners with two candidates": int(np.sum(verdict == Verdict.AMBIGUOUS)),
            "corners without mutual best": int(np.sum(verdict == Verdict.ONE_SIDED)),
            "corners that do not agree (consistency)": int(np.sum(verdict == Verdict.INCONSISTENT)),
        }

    def _gates(self, features: CfSmaFeatures, paired: Ints, matched: Ints) -> Codes:
        gates = np.full(features.points.shape[0], Gate.ISOLATED, dtype=np.uint8)
        for start, stop in zip(features.starts, features.stops, strict=True):
            gates[start:stop] = Gate.UNCORRELATED
        for k, verdict in zip(paired, self.segment_verdicts, strict=True):
            gates[features.starts[k] : features.stops[k]] = _GATE_OF_VERDICT[verdict]
        gates[matched] = Gate.MATCHED
        by_beam = np.full(features.n_beams, Gate.NO_READING, dtype=np.uint8)
        by_beam[features.beam_idx] = gates
        return by_beam
