"""The checks of a log: one function a topic, each issue with its consequence and the option that handles it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from curvescan.diagnostics.beam_order import BeamOrder
from curvescan.diagnostics.report import LogReport, TimeSummary
from curvescan.diagnostics.rotation_direction import RotationDirection


class Problem(NamedTuple):
    """An issue without its topic, which is that of the check; the fields are those of Issue."""

    kind: str
    what: str
    consequence: str = ""
    option: str = ""


_LOW_VALID_SHARE = 0.25
_UNEVEN = 3.0
_STALE = 0.1
_MISSING = 0.005


def on_file(report: LogReport) -> Iterator[Problem]:
    """Yield what is broken in the file and what the reader left out or assumed."""
    for read_error in report.read_errors:
        yield Problem(
            "read_error",
            f"{read_error.rule}: {_counted(read_error.count, 'time')}, first in {read_error.first}; the rest of the log is read",
        )
    for note in report.notes:
        yield Problem("note", note)


def on_scans(report: LogReport) -> Iterator[Problem]:
    """Yield what stands in the way of taking the scans for a sequence."""
    if report.n_scans < 2:
        yield Problem("too_few_scans", f"the log holds {_counted(report.n_scans, 'scan')}", "a motion needs two")
    if len(report.beam_counts) > 1:
        counts = ", ".join(f"{n} ({_counted(k, 'scan')})" for n, k in report.beam_counts.items())
        yield Problem("changing_beams", f"the number of beams changes: {counts}", "each scan is taken with its own")
    if report.n_repeated_scans:
        yield Problem(
            "repeated_scans",
            f"{_of(report.n_repeated_scans, report.n_scans, 'scan')} repeat exactly the readings of the scan before",
            "if the robot moved meanwhile, they do not show it",
        )


def on_beams(report: LogReport) -> Iterator[Problem]:
    """Yield which beams do not say what is there now, or point elsewhere than they say."""
    if report.stale_share >= _STALE:
        yield Problem(
            "stale_beams",
            f"{report.stale_share:.0%} of the readings are those of the sweep before, to the last digit, while the "
            "others change",
            "the driver keeps old values where a beam met nothing new; they smear when the sensor moves",
            "--drop-stale",
        )
    if report.fixed_beams:
        yield _on_fixed_beams(report)
    yield from _on_beam_order(report.beam_order)
    yield from _on_rotation(report.sense, is_upside_down=report.is_upside_down)


def _on_beam_order(order: BeamOrder | None) -> Iterator[Problem]:
    if order is not None and order.is_reversed_order:
        yield Problem(
            "beams_reversed",
            f"in {_counted(order.n_pairs, 'pair')} of scans the beams agree better in the reverse of the order in which "
            "the log lists them",
            "sweeps are not deskewed",
            "--backwards",
        )


def _on_rotation(sense: RotationDirection | None, *, is_upside_down: bool) -> Iterator[Problem]:
    if sense is None:
        return
    if sense.is_reversed:
        doubt = ", or the gyroscope's z axis points down" * (sense.reference == "gyroscope")
        yield Problem(
            "turns_against",
            f"the scans turn against the {sense.reference} in {sense.n_reversed} of {sense.n_turns} sharp turns",
            "the beams run the other way than the log says (a clockwise or upside-down sensor)"
            f"{doubt}, and motion and map come out as in a mirror",
            "--upright" if is_upside_down else "--clockwise",
        )
    if sense.is_in_degrees:
        yield Problem(
            "gyro_in_degrees",
            f"the gyroscope turns {sense.ratio:.0f} times as far as the scans",
            "it gives degrees where REP-103 requires radians; as a motion prior they are taken for what they are",
        )


def _on_fixed_beams(report: LogReport) -> Problem:
    runs = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in report.fixed_beams)
    n_beams = max(report.beam_counts, key=lambda n: report.beam_counts[n])
    # what lies nearer to the beginning of the sweep is cut off there, the rest at its end
    first = max((b + 1 for _, b in report.fixed_beams if b < n_beams // 4), default=0)
    last = max((n_beams - a for a, _ in report.fixed_beams if a >= 3 * n_beams // 4), default=0)
    return Problem(
        "fixed_beams",
        f"beams {runs} keep their reading within 3 cm while the others change",
        "they see the robot itself, which moves along and is no part of the room",
        f"--ignore-beams {first} {last}" if first or last else "",
    )


def on_time(report: LogReport) -> Iterator[Problem]:
    """Yield what is wrong with the stamps, and with the times of the beams."""
    if report.time.n_steps:
        yield from _on_steps(report.time)
    if report.n_scans and not report.n_timed_scans:
        yield Problem(
            "no_beam_times",
            "the beams have no times of their own (time_increment)",
            "a sweep is taken for a moment, and the motion during it cannot be undone",
        )
    elif report.sweep_seconds > 1.05 * report.time.step_median:
        yield Problem(
            "beam_times_too_long",
            f"by the times of its beams a sweep takes {report.sweep_seconds:.3g} s, and the next one starts after "
            f"{report.time.step_median:.3g} s",
            "one of the two is wrong, and undoing the motion during a sweep would bend it",
        )


def _on_steps(time: TimeSummary) -> Iterator[Problem]:
    if time.n_equal == time.n_steps:
        yield Problem(
            "equal_stamps", "all stamps are equal", "scans are taken in file order, rate and speeds are unknown"
        )
        return
    if time.n_back:
        yield Problem(
            "time_goes_back",
            f"{_of(time.n_back, time.n_steps, 'time step')} go back, by up to {time.largest_back:.3g} s",
            "scans are taken in file order, stamps are kept as they are",
        )
    if time.n_equal:
        yield Problem(
            "zero_steps",
            f"{_of(time.n_equal, time.n_steps, 'time step')} are zero",
            "no speed can be computed from them",
        )
    if time.n_leaps:
        yield Problem(
            "leaps",
            f"{_counted(time.n_leaps, 'time step')} of more than ten times the usual {time.step_median:.3g} s, the "
            f"longest of {time.largest_leap:.4g} s",
            "the robot may have moved far between the two scans",
        )
    n_all = time.n_steps + 1 + time.n_missing
    if time.n_missing > _MISSING * n_all:
        yield Problem(
            "missing_sweeps",
            f"about {time.n_missing:,} of {n_all:,} sweeps are missing: a step usually takes {time.step_median:.3g} s, the "
            f"longest {time.step_max:.3g} s",
            "the robot moved further between the scans beside them",
        )
    elif not time.n_leaps and time.step_max > _UNEVEN * time.step_median:
        yield Problem(
            "uneven_steps",
            f"time steps are uneven, {time.step_min:.3g} to {time.step_max:.3g} s around a median of "
            f"{time.step_median:.3g} s",
            "speeds computed from single steps are unreliable",
        )


def on_readings(report: LogReport) -> Iterator[Problem]:
    """Yield what is wrong with the readings."""
    if report.n_scans and report.n_blank_scans == report.n_scans:
        yield Problem(
            "no_valid_reading",
            f"no scan has a reading within {report.range_min:g} to {report.range_max:g} m",
            "nothing can be matched; check the range limits and the unit",
        )
        return
    if report.n_blank_scans:
        yield Problem(
            "blank_scans",
            f"{_of(report.n_blank_scans, report.n_scans, 'scan')} have no valid reading",
            "they cannot be matched",
        )
    if report.valid_share < _LOW_VALID_SHARE:
        yield Problem(
            "few_valid",
            f"only {report.valid_share:.1%} of the readings are valid",
            "matches rest on few points and are less certain",
        )
    if report.suspect is not None:
        value = report.suspect.value
        yield Problem(
            "undeclared_code",
            f"{report.suspect.share:.1%} of all readings are exactly {value:g} m, at the top of the range",
            "it looks like a code for no reading and would be taken for a wall",
            f"--range-max {0.99 * value:.3g}",
        )
    elif report.code_band is not None:
        low, high, share = report.code_band
        yield Problem(
            "undeclared_codes",
            f"{share:.1%} of all readings lie between {low:.2f} and {high:.2f} m, at the top of the range, in beams all around",
            "they look like codes for no reading and would be drawn as arcs in the map",
            f"--range-max {0.99 * low:.3g}",
        )


def on_odometry(report: LogReport) -> Iterator[Problem]:
    """Yield what is wrong with the odometry."""
    if report.odometry is None:
        yield Problem("no_odometry", "the log has no odometry", "motion is estimated from the scans alone")
        return
    if report.odometry.n_missing:
        yield Problem(
            "odometry_gaps",
            f"{_of(report.odometry.n_missing, report.n_scans, 'scan')} have no odometry pose",
            "odometry cannot help to match them",
        )
    if report.odometry.lag:
        late = "late" if report.odometry.lag > 0.0 else "early"
        yield Problem(
            "odometry_lag",
            f"the odometry turns {abs(report.odometry.lag):.2g} s too {late} against the scans",
            "it has another clock; --odometry-prior takes the lag out",
        )


def _of(part: int, whole: int, noun: str) -> str:
    return f"{part:,} of {_counted(whole, noun)}"


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
