"""The findings of a report in sentences: what is wrong or odd, and what follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from curvescan.io.report import LogReport, TimeSummary

Topic: TypeAlias = Literal["file", "scans", "time", "readings", "odometry"]
"""What a finding is about."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that is wrong or odd with a log.

    Attributes
    ----------
    topic : Topic
        What it is about.
    sentence : str
        What was found, and what follows from it.
    """

    topic: Topic
    sentence: str


def findings_of(report: LogReport) -> tuple[Finding, ...]:
    """Return what is wrong or odd with a log, each with its consequence; empty for a sound one."""
    return tuple(
        Finding(topic=topic, sentence=sentence)
        for topic, find in _FINDERS.items()
        for sentence in find(report)
    )


_LOW_VALID_SHARE = 0.25
_UNEVEN = 3.0


def _on_file(report: LogReport) -> Iterator[str]:
    """Yield what is broken in the file and what the reader left out or assumed."""
    for fault in report.faults:
        yield f"{fault.rule}: {_counted(fault.count, 'time')}, first in {fault.first}; the rest of the log is read"
    yield from report.notes


def _on_scans(report: LogReport) -> Iterator[str]:
    """Yield what stands in the way of taking the scans for a sequence."""
    if report.n_scans < 2:
        yield f"the log holds {_counted(report.n_scans, 'scan')}: a motion needs two"
    if len(report.beam_counts) > 1:
        counts = ", ".join(f"{n} ({_counted(k, 'scan')})" for n, k in report.beam_counts.items())
        yield f"the number of beams changes: {counts}; each scan is taken with its own"
    if report.n_repeated_scans:
        yield (
            f"{_of(report.n_repeated_scans, report.n_scans, 'scan')} repeat exactly the readings of the "
            "scan before: if the robot moved meanwhile, they do not show it"
        )


def _on_time(report: LogReport) -> Iterator[str]:
    """Yield what is wrong with the stamps."""
    time = report.time
    if not time.n_steps:
        return
    if time.n_equal == time.n_steps:
        yield "all stamps are equal: scans are taken in file order, rate and speeds are unknown"
        return
    if time.n_back:
        yield (
            f"{_of(time.n_back, time.n_steps, 'time step')} go back, by up to {time.largest_back:.3g} s: "
            "scans are taken in file order, stamps are kept as they are"
        )
    if time.n_equal:
        yield (
            f"{_of(time.n_equal, time.n_steps, 'time step')} are zero: "
            "no speed can be computed from them"
        )
    if time.n_leaps:
        yield (
            f"{_counted(time.n_leaps, 'time step')} of more than ten times the usual {time.step_median:.3g} s, "
            f"the longest of {time.largest_leap:.4g} s: the robot may have moved far between the two scans"
        )
    elif time.step_max > _UNEVEN * time.step_median:
        yield _uneven(time)


def _on_readings(report: LogReport) -> Iterator[str]:
    """Yield what is wrong with the readings."""
    if report.n_scans and report.n_blank_scans == report.n_scans:
        yield (
            f"no scan has a reading within {report.range_min:g} to {report.range_max:g} m: nothing can be "
            "matched; check the range limits and the unit"
        )
        return
    if report.n_blank_scans:
        yield (
            f"{_of(report.n_blank_scans, report.n_scans, 'scan')} have no valid reading: "
            "they cannot be matched"
        )
    if report.valid_share < _LOW_VALID_SHARE:
        yield (
            f"only {report.valid_share:.1%} of the readings are valid: matches rest on few points and are less certain"
        )
    if report.suspect is not None:
        value = report.suspect.value
        yield (
            f"{report.suspect.share:.1%} of all readings are exactly {value:g} m, at the top of the range: it looks like "
            f"a code for no reading and would be taken for a wall; try --range-max {0.99 * value:.3g}"
        )


def _on_odometry(report: LogReport) -> Iterator[str]:
    """Yield what is wrong with the odometry."""
    if report.odometry is None:
        yield "the log has no odometry: motion is estimated from the scans alone"
    elif report.odometry.n_missing:
        yield (
            f"{_of(report.odometry.n_missing, report.n_scans, 'scan')} have no odometry pose: "
            "odometry cannot help to match them"
        )


def _uneven(time: TimeSummary) -> str:
    return (
        f"time steps are uneven, {time.step_min:.3g} to {time.step_max:.3g} s around a median of "
        f"{time.step_median:.3g} s: speeds computed from single steps are unreliable"
    )


def _of(part: int, whole: int, noun: str) -> str:
    return f"{part:,} of {_counted(whole, noun)}"


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


_FINDERS: dict[Topic, Callable[[LogReport], Iterator[str]]] = {
    "file": _on_file,
    "scans": _on_scans,
    "time": _on_time,
    "readings": _on_readings,
    "odometry": _on_odometry,
}
