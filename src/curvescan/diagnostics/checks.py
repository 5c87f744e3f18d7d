"""The checks of a log, a row each: kind, test, sentence, consequence, argument that handles it, mending by a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

from curvescan.diagnostics.report import LogReport

if TYPE_CHECKING:
    from curvescan.diagnostics.prior.gyroscope import Gyroscope
    from curvescan.diagnostics.rotation_direction import RotationDirection

_LOW_VALID_SHARE = 0.25
_UNEVEN = 3.0
_MISSING = 0.005
_REST_IS_READ = "; the rest of the log is read"

_STALE, _CERTAINLY_STALE = 0.1, 0.2
"""Shares of readings that repeat the sweep before: sound logs at hand have up to 0.09, faulty ones 0.30 and 0.32."""

_MIN_ORDERED = 20  # pairs of scans from which on their mean gain is about as certain as its standard error says

_SCATTERED = 0.7
"""Bins that no beam hit are scattered, 0.27 to 0.39 of them beside another; beams along a wall repeat in long runs."""

Topic: TypeAlias = Literal["file", "scans", "beams", "time", "readings", "odometry"]  # what an issue is about


class Remedy(NamedTuple):
    """An argument of :func:`curvescan.read_log` that handles an issue, and its value."""

    argument: str
    value: float | bool | tuple[int, int]

    def __str__(self) -> str:
        value = self.value
        return f"{self.argument}={value if isinstance(value, bool | tuple) else f'{value:g}'}"


class Check(NamedTuple):
    """A row: the sentences are those of Issue, made of the report of a log where the test holds."""

    topic: Topic
    kind: str
    test: Callable[[LogReport], bool]
    what: Callable[[LogReport], str | tuple[str, ...]]
    consequence: str | Callable[[LogReport], str] = ""
    remedy: Callable[[LogReport], Remedy | None] | None = None
    mending: str | Callable[[LogReport], str] = ""


def _of(part: int, whole: int, noun: str) -> str:
    return f"{part:,} of {_counted(whole, noun)}"


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def _is_reversed(r: LogReport) -> bool:
    return r.sense is not None and r.sense.is_reversed


def _is_blank(r: LogReport) -> bool:
    return r.n_scans > 0 and r.n_blank_scans == r.n_scans


def _sense(r: LogReport) -> RotationDirection:
    assert r.sense is not None
    return r.sense


def _n_ordered(r: LogReport) -> int:
    return r.beam_order.n_pairs if r.beam_order else 0


def _gyroscope(r: LogReport) -> Gyroscope:
    assert r.gyroscope is not None
    return r.gyroscope


def _range_limit(r: LogReport) -> float:
    """Return the limit that leaves out the codes at the top of the range, to three digits."""
    assert r.code_band is not None or r.suspect is not None
    lowest = r.suspect.value if r.code_band is None and r.suspect else r.code_band[0] if r.code_band else 0.0
    return float(f"{0.99 * lowest:.3g}")


def _codes(r: LogReport) -> str:
    assert r.code_band is not None
    low, high, share = r.code_band
    place = "at the top of the range, in beams all around"
    return f"{share:.1%} of all readings lie between {low:.2f} and {high:.2f} m, {place}"


def _ring(r: LogReport) -> str:
    assert r.ring is not None
    low, high, share, is_loose = r.ring
    kind = " that are of no surface" * is_loose
    return f"{share:.1%} of all readings are some{kind} between {low:.2f} and {high:.2f} m, in beams all around"


def _fixed_ends(r: LogReport) -> tuple[int, int]:
    """Return how many beams to ignore at either end: a fixed one nearer to the beginning is cut off there."""
    assert r.fixed_beams is not None
    runs, n = r.fixed_beams
    first = max((b + 1 for _, b in runs if b < n // 4), default=0)
    last = max((n - a for a, _ in runs if a >= 3 * n // 4), default=0)
    return first, last


def _fixed(r: LogReport) -> str:
    assert r.fixed_beams is not None
    return "beams " + ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in r.fixed_beams.runs)


def _is_missing(r: LogReport) -> bool:
    return r.time.n_missing > _MISSING * (r.time.n_steps + 1 + r.time.n_missing)


def _has_steps(r: LogReport) -> bool:
    return r.time.n_steps > 0 and r.time.n_equal < r.time.n_steps


CHECKS: tuple[Check, ...] = (
    Check(
        "file",
        "read_error",
        lambda r: bool(r.read_errors),
        lambda r: tuple(
            f"{e.rule}: {_counted(e.count, 'time')}, first in {e.first}" + _REST_IS_READ * ("is read" not in e.rule)
            for e in r.read_errors
        ),
    ),
    Check("file", "note", lambda r: bool(r.notes), lambda r: r.notes),
    Check(
        "scans",
        "too_few_scans",
        lambda r: r.n_scans < 2,
        lambda r: f"the log holds {_counted(r.n_scans, 'scan')}",
        "a motion needs two",
    ),
    Check(
        "scans",
        "changing_beams",
        lambda r: len(r.beam_counts) > 1,
        lambda r: (
            "the number of beams changes: "
            + ", ".join(f"{n} ({_counted(k, 'scan')})" for n, k in r.beam_counts.items())
        ),
        "each scan is taken with its own",
    ),
    Check(
        "scans",
        "repeated_scans",
        lambda r: r.n_repeated_scans > 0,
        lambda r: f"{_of(r.n_repeated_scans, r.n_scans, 'scan')} repeat exactly the readings of the scan before",
        "if the robot moved meanwhile, they do not show it",
    ),
    Check(
        "beams",
        "stale_beams",
        lambda r: r.stale_share >= _STALE,
        lambda r: (
            f"{r.stale_share:.0%} of the readings are those of the sweep before, to the last digit, "
            "while the others change"
        ),
        "the driver keeps old values where a beam met nothing new; they smear when the sensor moves",
        lambda _: Remedy("drop_stale", True),
        lambda r: (
            f"dropped: readings that repeat the sweep before to the last digit, {r.stale_share:.0%} of all"
            * (r.stale_share >= _CERTAINLY_STALE and r.stale_run < _SCATTERED)
        ),
    ),
    Check(
        "beams",
        "fixed_beams",
        lambda r: r.fixed_beams is not None,
        lambda r: f"{_fixed(r)} keep their reading within 3 cm while the others change",
        "they see the robot itself, which moves along and is no part of the room",
        lambda r: Remedy("ignore_beams", _fixed_ends(r)) if any(_fixed_ends(r)) else None,
        lambda r: f"left out: {_fixed(r)}, which see the robot itself and keep their reading while the others change",
    ),
    Check(
        "beams",
        "beams_reversed",
        lambda r: r.beam_order is not None and r.beam_order.is_reversed_order,
        lambda r: (
            f"in {_counted(_n_ordered(r), 'pair')} of scans the beams agree better in the "
            "reverse of the order in which the log lists them"
        ),
        "sweeps are not deskewed",
        lambda _: Remedy("backwards", True),
        lambda r: (
            (
                "turned round: the order of the beams of each sweep, which agree better so in "
                f"{_n_ordered(r):,} pairs of scans"
            )
            * (_n_ordered(r) >= _MIN_ORDERED)
        ),
    ),
    Check(
        "beams",
        "turns_against",
        _is_reversed,
        lambda r: (
            f"the scans turn against the {_sense(r).reference} "
            f"in {_sense(r).n_reversed} of {_sense(r).n_turns} sharp turns"
        ),
        lambda r: (
            "the beams run the other way than the log says (a clockwise or upside-down sensor)"
            + ", or the gyroscope's z axis points down" * (_sense(r).reference == "gyroscope")
            + ", and motion and map come out as in a mirror"
        ),
        lambda r: Remedy("upside_down", False) if r.is_upside_down else Remedy("clockwise", True),
        lambda r: (
            (
                f"mirrored: the scans, which turn against the {_sense(r).reference} in {_sense(r).n_reversed} of "
                f"{_sense(r).n_turns} sharp turns"
            )
            * _sense(r).is_certainly_reversed
        ),
    ),
    Check(
        "beams",
        "gyro_in_degrees",
        lambda r: r.sense is not None and r.sense.is_in_degrees,
        lambda r: f"the gyroscope turns {_sense(r).ratio:.0f} times as far as the scans",
        "it gives degrees where REP-103 requires radians",
        None,
        lambda r: f"taken for degrees: the gyroscope, which turns {_sense(r).ratio:.0f} times as far as the scans",
    ),
    Check(
        "beams",
        "gyro_bias",
        lambda r: r.gyroscope is not None and r.gyroscope.is_biased,
        lambda r: f"the gyroscope turns by {math.degrees(_gyroscope(r).bias):.1f} deg/s while the scans do not",
        "as a motion prior it would turn the robot by as much",
        None,
        lambda r: f"taken off: the gyroscope's bias of {math.degrees(_gyroscope(r).bias):.1f} deg/s",
    ),
    Check(
        "beams",
        "bent_sweeps",
        lambda r: r.gyroscope is not None and r.gyroscope.straightens,
        lambda r: (
            f"sweeps are bent on the turn: without the gyroscope's turn during each they agree better in "
            f"{_gyroscope(r).n_turns} sharp turns"
        ),
        "the beams have no times of their own; a sweep takes the time from one stamp to the next",
        None,
        lambda r: (
            "straightened: sweeps, by the gyroscope's turn during each; "
            f"they agree better in {_gyroscope(r).n_turns} turns"
        ),
    ),
    Check(
        "time",
        "equal_stamps",
        lambda r: r.time.n_steps > 0 and r.time.n_equal == r.time.n_steps,
        lambda r: "all stamps are equal",
        "scans are taken in file order, rate and speeds are unknown",
    ),
    Check(
        "time",
        "time_goes_back",
        lambda r: r.time.n_back > 0,
        lambda r: f"{_of(r.time.n_back, r.time.n_steps, 'time step')} go back, by up to {r.time.largest_back:.3g} s",
        "scans are taken in file order, stamps are kept as they are",
    ),
    Check(
        "time",
        "zero_steps",
        lambda r: _has_steps(r) and r.time.n_equal > 0,
        lambda r: f"{_of(r.time.n_equal, r.time.n_steps, 'time step')} are zero",
        "no speed can be computed from them",
    ),
    Check(
        "time",
        "leaps",
        lambda r: r.time.n_leaps > 0,
        lambda r: (
            f"{_counted(r.time.n_leaps, 'time step')} of more than ten times the usual {r.time.step_median:.3g} s, the "
            f"longest of {r.time.largest_leap:.4g} s"
        ),
        "the robot may have moved far between the two scans",
    ),
    Check(
        "time",
        "missing_sweeps",
        _is_missing,
        lambda r: (
            f"about {r.time.n_missing:,} of {r.time.n_steps + 1 + r.time.n_missing:,} sweeps are missing: "
            f"a step usually takes {r.time.step_median:.3g} s, the longest {r.time.step_max:.3g} s"
        ),
        "the robot moved further between the scans beside them",
    ),
    Check(
        "time",
        "uneven_steps",
        lambda r: (
            _has_steps(r)
            and not _is_missing(r)
            and not r.time.n_leaps
            and r.time.step_max > _UNEVEN * r.time.step_median
        ),
        lambda r: (
            f"time steps are uneven, {r.time.step_min:.3g} to {r.time.step_max:.3g} s around a median of "
            f"{r.time.step_median:.3g} s"
        ),
        "speeds computed from single steps are unreliable",
    ),
    Check(
        "time",
        "no_beam_times",
        lambda r: r.n_scans > 0 and not r.n_timed_scans,
        lambda r: "the beams have no times of their own (time_increment)",
        "a sweep is taken for a moment, and the motion during it cannot be undone",
    ),
    Check(
        "time",
        "beam_times_too_long",
        lambda r: r.n_timed_scans > 0 and r.sweep_seconds > 1.05 * r.time.step_median,
        lambda r: (
            f"by the times of its beams a sweep takes {r.sweep_seconds:.3g} s, and the next one starts after "
            f"{r.time.step_median:.3g} s"
        ),
        "one of the two is wrong, and undoing the motion during a sweep would bend it",
    ),
    Check(
        "readings",
        "no_valid_reading",
        _is_blank,
        lambda r: f"no scan has a reading within {r.range_min:g} to {r.range_max:g} m",
        "nothing can be matched; check the range limits and the unit",
    ),
    Check(
        "readings",
        "blank_scans",
        lambda r: r.n_blank_scans > 0 and not _is_blank(r),
        lambda r: f"{_of(r.n_blank_scans, r.n_scans, 'scan')} have no valid reading",
        "they cannot be matched",
    ),
    Check(
        "readings",
        "few_valid",
        lambda r: r.valid_share < _LOW_VALID_SHARE and not _is_blank(r),
        lambda r: f"only {r.valid_share:.1%} of the readings are valid",
        "matches rest on few points and are less certain",
    ),
    Check(
        "readings",
        "undeclared_code",
        lambda r: r.suspect is not None and r.code_band is None,
        lambda r: (
            f"{r.suspect.share:.1%} of all readings are exactly {r.suspect.value:g} m, at the top of the range"
            if r.suspect
            else ""
        ),
        "it looks like a code for no reading and would be taken for a wall",
        lambda r: Remedy("range_max", _range_limit(r)),
    ),
    Check(
        "readings",
        "undeclared_codes",
        lambda r: r.code_band is not None,
        _codes,
        "they look like codes for no reading and would be drawn as arcs in the map",
        lambda r: Remedy("range_max", _range_limit(r)),
        lambda r: f"ignored: readings beyond {_range_limit(r):g} m, codes for no return ({_codes(r)})",
    ),
    Check(
        "readings",
        "ring",
        lambda r: r.ring is not None and r.code_band is None,
        _ring,
        "they turn with the sensor (a code for no return, a rim, the robot itself) and would hold its motion back",
        None,
        lambda r: f"ignored: readings at one range in all directions ({_ring(r)})",
    ),
    Check(
        "odometry",
        "no_odometry",
        lambda r: r.odometry is None,
        lambda r: "the log has no odometry",
        "motion is estimated from the scans alone",
    ),
    Check(
        "odometry",
        "odometry_gaps",
        lambda r: r.odometry is not None and r.odometry.n_missing > 0,
        lambda r: f"{_of(r.odometry.n_missing if r.odometry else 0, r.n_scans, 'scan')} have no odometry pose",
        "odometry cannot help to match them",
    ),
    Check(
        "odometry",
        "odometry_lag",
        lambda r: r.odometry is not None and r.odometry.lag != 0.0,
        lambda r: (
            f"the odometry turns {abs(r.odometry.lag if r.odometry else 0.0):.2g} s too "
            f"{'late' if r.odometry and r.odometry.lag > 0.0 else 'early'} against the scans"
        ),
        "it has another clock; as a motion prior it is used without the lag",
    ),
)
