"""A verdict: whether the result of a run can be trusted, and why not.

It is judged by what the run ended with, not by what happened on the way: parts that stayed apart, the covariance of the
final poses, matches that contradict the finished map, scans that are not in the map, faults of the log that spoil
the readings.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from curvescan.configs import counted, shipped_table
from curvescan.diagnostics.breaks import Break, find_ambiguous, find_frozen, find_torn, find_untied, joins_in_doubt
from curvescan.diagnostics.issues import Sentences
from curvescan.diagnostics.preparation import PreparedLog
from curvescan.diagnostics.top_of_range import runs_of
from curvescan.engines import RunRecord
from curvescan.engines.engine import Engine
from curvescan.io.log import ScanAccess
from curvescan.odometry.step import StepOutcome
from curvescan.slam import Localizer, Slam
from curvescan.slam.pose_graph.posterior import covariances_seen_from
from curvescan.types import Bools

MAX_UNMATCHED, MAX_UNMATCHED_SHARE = 2, 0.02
"""So many scans without a match, or this share of them, are bridged by the expected motion."""

MAX_BRIDGED_SHARE, MAX_DRIVEN_SHARE = 0.2, 0.5
"""The same of SLAM, whose covariances tell what the motion bridged, and of wheels that are used: beyond it there is
little left to map."""

MAX_SIGMA = 0.5  # greatest standard deviation of a position on a short path that can still be called known, metres
MAX_DRIFT, MAX_SIGMA_SHARE = 0.02, 0.0125
"""The same of odometry as a share of a long path, and of SLAM as a share of the size of a large place."""

MAX_OPEN_SHARE, MAX_OPEN_SHARE_SLAM = 0.3, 0.9
"""Share of the scans that may leave the motion along one direction to what is usual, where no wheels tell it: of
odometry, and of SLAM, whose covariances tell what it closed since. Beyond the second nothing tells what is usual."""

_IN_ROW = 0.1  # share of what steps in a row slip along an open way which all of them slip alike
MIN_FOUND = 0.9  # share of the scans that must be found in a saved map
_SPOILING = ("stale_beams", "turns_against", "undeclared_code", "undeclared_codes", "no_valid_reading")
"""Kinds of issues that spoil readings so that what is made of them is not to be trusted."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run can be trusted."""

    is_trusted: bool  # whether nothing speaks against the result
    reasons: tuple[str, ...] = ()  # what speaks against it: a clause each, with its figures and what helps

    @property
    def sentence(self) -> str:
        """The last line of a run."""
        if self.is_trusted:
            return "trusted: nothing in the result speaks against it"
        return f"not to be trusted: {'; '.join(self.reasons)}"


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The figures of a result that a verdict is judged by; engine: "odometry", "slam" or "localization".

    is_unmatched, is_open, is_known (n,): scans without a match, with a direction left unobservable, with a known pose;
    path, extent (of the path, from corner to corner) and sigma in metres; contradictions: matches, keyframes and place
    x, y of each group; motion: "used", "left out" or "none".
    """

    engine: str = "odometry"
    n_scans: int
    n_recorded: int = 0
    is_cut: bool = False
    is_interrupted: bool = False
    is_unmatched: Bools
    is_open: Bools
    is_known: Bools
    path: float = 0.0
    extent: float = 0.0
    sigma: float = 0.0
    breaks: tuple[Break, ...] = ()
    n_parts: int = 1
    contradictions: tuple[tuple[int, int, float, float], ...] = ()
    motion: str = "none"
    faults: tuple[str, ...] = ()

    @property
    def is_slam(self) -> bool:
        """Whether loops were closed."""
        return self.engine == "slam"

    @property
    def n_unmatched(self) -> int:
        """Scans without a match."""
        return int(np.count_nonzero(self.is_unmatched))

    @property
    def found(self) -> float:
        """Share of the scans whose pose is known."""
        return float(np.mean(self.is_known)) if self.is_known.size else 0.0

    @property
    def open_share(self) -> float:
        """Share of the scans that leave a direction unobservable."""
        return float(np.mean(self.is_open)) if self.is_open.size else 0.0

    @property
    def most_unmatched(self) -> float:
        """Most scans that may be without a match."""
        of_slam = MAX_DRIVEN_SHARE if self.motion == "used" else MAX_BRIDGED_SHARE
        return max(MAX_UNMATCHED, (of_slam if self.is_slam else MAX_UNMATCHED_SHARE) * (self.n_scans - 1))

    @property
    def is_guessed(self) -> bool:
        """Whether too many scans leave the motion along one direction to what is usual, where no wheels tell it."""
        most = MAX_OPEN_SHARE_SLAM if self.is_slam else MAX_OPEN_SHARE
        return self.engine != "localization" and self.motion != "used" and self.open_share > most

    @property
    def most_sigma(self) -> float:
        """Greatest standard deviation of a known position, metres."""
        return max(MAX_SIGMA, MAX_SIGMA_SHARE * self.extent if self.is_slam else MAX_DRIFT * self.path)


_TESTS: dict[str, Callable[[Evidence], bool]] = {
    "too_few": lambda e: e.n_scans < 2,
    "cut": lambda e: e.is_cut,
    "interrupted": lambda e: e.is_interrupted,
    "parts": lambda e: e.n_parts > 1,
    "not_found": lambda e: e.engine == "localization" and e.found < MIN_FOUND,
    "unmatched": lambda e: e.engine != "localization" and e.n_unmatched > e.most_unmatched,
    "uncertain": lambda e: e.n_parts == 1 and e.sigma > e.most_sigma,
    "guessed": lambda e: e.is_guessed,
    "contradicted": lambda e: bool(e.contradictions),
}
"""Where each reason of verdict.toml holds that is no kind of break."""

_FILL = Sentences(
    {
        "end": lambda e: (
            f"{e.n_scans:,} of about {e.n_recorded:,} scans are there"
            if e.n_recorded > e.n_scans
            else "its end is missing"
        ),
        "found": lambda e: (
            f"found in the map in {e.found:.0%} of the scans, first in scan {int(np.argmax(e.is_known)):,}"
            if e.is_known.any()
            else "not found in the map"
        ),
        "where_open": lambda e: (
            f"; in {counted(int(e.is_open.sum()), 'scan')}, up to {_longest(e.is_open):,} in a row, motion along "
            "one direction is unobservable"
            if e.is_open.any()
            else ""
        ),
        "made": lambda e: "map" if e.is_slam else "trajectory",
        "n_steps": lambda e: e.n_scans - 1,
        "unmatched_share": lambda e: e.n_unmatched / (e.n_scans - 1),
        "longest_unmatched": lambda e: _longest(e.is_unmatched),
        "closing": lambda e: "a drive that comes back there" if e.is_slam else "SLAM, which closes loops",
        "how": lambda e: "while the wheels drive" if e.motion == "used" else "and the scans after it leap by",
        "n_matches": lambda e: sum(c[0] for c in e.contradictions),
        "n_keyframes": lambda e: sum(c[1] for c in e.contradictions),
    }
).format
_BY_MOTION = {
    "left out": "the log's wheels or gyroscope, odometry_prior=True; or ",
    "none": "a log with wheel odometry; or ",
}
"""What helps where wheels would: those of the log where they were left out, wheels where it has none."""


def judge(record: RunRecord, engine: Engine, prepared: PreparedLog | None = None) -> Verdict:
    """Return whether the result of a run can be trusted, and why not; prepared: its log, where there is one."""
    return verdict_of(evidence_of(record, engine, prepared))


def verdict_of(evidence: Evidence) -> Verdict:
    """Return the verdict on the figures of a result."""
    reasons = []
    for name, row in shipped_table(__package__, "verdict.toml").items():
        longest = max((b for b in evidence.breaks if b.kind == name), key=lambda b: b.metres, default=None)
        if longest is not None or (name in _TESTS and _TESTS[name](evidence)):
            helps = _BY_MOTION.get(evidence.motion, "") * row.get("by_motion", False) + row.get("helps", "")
            sentence = row["what"] + f"; what helps: {helps}" * bool(helps)
            reasons.append(_FILL(sentence, e=evidence, b=longest))
    reasons += evidence.faults
    return Verdict(is_trusted=not reasons, reasons=tuple(reasons))


def evidence_of(record: RunRecord, engine: Engine, prepared: PreparedLog | None = None) -> Evidence:
    """Return the figures of a result that a verdict is judged by."""
    poses = record.trajectory.poses
    known = poses[np.isfinite(poses[:, 0]), :2]
    name, n_parts = "odometry", 1 + record.outcomes.count(StepOutcome.LOST)
    contradictions: tuple[tuple[int, int, float, float], ...] = ()
    if isinstance(engine, Localizer):
        name, n_parts = "localization", 1
    elif isinstance(engine, Slam):
        name, n_parts = "slam", engine.n_fragments
        contradictions = tuple((len(c.pairs), len({*c.pairs[:, 1]}), *c.place.tolist()) for c in engine.contradictions)
    log, issues = (None, ()) if prepared is None else (prepared.log, prepared.issues)
    evidence = Evidence(
        engine=name,
        n_scans=len(poses),
        n_recorded=log.n_recorded() if isinstance(log, ScanAccess) else 0,
        is_cut=log is not None and any(error.is_end for error in log.read_errors),
        is_interrupted=record.is_partial,
        is_unmatched=record.is_failed,
        is_open=record.is_degenerate,
        is_known=np.isfinite(poses[:, 0]),
        path=float(np.sum(np.hypot(*np.diff(known, axis=0).T))),
        extent=float(np.hypot(*np.ptp(known, axis=0))) if len(known) else 0.0,
        sigma=largest_sigma(record, engine),
        n_parts=n_parts,
        contradictions=contradictions,
        motion="used" if record.has_prior else "left out" if prepared and prepared.prior.sentence else "none",
        faults=tuple(i.what + f"; what helps: {i.argument}" * bool(i.remedy) for i in issues if i.kind in _SPOILING),
    )
    if evidence.engine == "localization" or len(poses) < 2:
        return evidence
    wheels = prepared.odometry_poses if prepared is not None and record.has_prior else None
    breaks = find_frozen(record, evidence.most_sigma, wheels)
    if isinstance(engine, Slam):
        breaks += find_torn(engine, evidence.most_sigma, has_wheels=wheels is not None)
        if wheels is not None and log is not None:
            breaks += find_untied(record, wheels, log, engine.map)
        if n_parts == 1 and joins_in_doubt(record):  # the map takes its time
            breaks += find_ambiguous(record, engine.map, engine.keyframes)
    return replace(evidence, breaks=tuple(breaks))


def largest_sigma(record: RunRecord, engine: Engine) -> float:
    """Return the greatest standard deviation of a position, metres, the few worst left out; 0 where none is known.

    Of a map it is that of the keyframes, seen from the middle one.
    """
    covariances = record.trajectory.covariances
    if isinstance(engine, Slam) and (graph := engine.graph).n_poses:
        covariances = covariances_seen_from(graph, graph.n_poses // 2, engine.config.noise, in_row=_IN_ROW)
    if covariances is None or not len(covariances):
        return 0.0
    variances = covariances[:, 0, 0] + covariances[:, 1, 1]
    known = variances[np.isfinite(variances)]
    return math.sqrt(0.5 * max(float(np.quantile(known, 1.0 - MAX_UNMATCHED_SHARE)), 0.0)) if known.size else 0.0


def _longest(mask: Bools) -> int:
    """Return the greatest number of True in a row."""
    return int(np.ptp(runs_of(mask), axis=1).max(initial=0))
