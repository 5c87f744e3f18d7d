"""The issues of a log: tests and figures here, and in issues.toml what is said of each in sentences."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from string import Formatter
from typing import Any, Literal, NamedTuple, TypeAlias

from curvescan.configs import counted, shipped_table
from curvescan.diagnostics.inspect import LogReport, ReadingCode

_LOW_VALID_SHARE = 0.25
_UNEVEN = 3.0
_MISSING = 0.005
_TOO_LONG = 1.05  # a sweep takes more than this share of the time from scan to scan

_STALE, _CERTAINLY_STALE = 0.1, 0.2
"""Shares of readings that repeat the sweep before: sound logs at hand have up to 0.09, faulty ones 0.30 and 0.32."""

_MIN_ORDERED = 20  # pairs of scans from which on their mean gain is about as certain as its standard error says

_SCATTERED = 0.7
"""Bins that no beam hit are scattered, 0.27 to 0.39 of them beside another; beams along a wall repeat in long runs."""

Topic: TypeAlias = Literal["file", "scans", "beams", "time", "readings", "odometry"]  # what an issue is about
Figure: TypeAlias = Callable[[Any], Any]  # of a report, where its parts that a test asks for are there


class Remedy(NamedTuple):
    """An argument of :func:`curvescan.read_log` that handles an issue, and its value."""

    argument: str
    value: float | bool | tuple[int, int]

    def __str__(self) -> str:
        value = self.value
        return f"{self.argument}={value if isinstance(value, bool | tuple) else f'{value:g}'}"


@dataclass(frozen=True, kw_only=True)
class Issue:
    """One thing that is wrong or odd with a log."""

    topic: Topic  # what it is about
    kind: str  # its name, the same in every log: ``"stale_beams"``
    what: str  # what was found, with its figures
    consequence: str = ""  # what follows from it; empty for a remark of the reader
    remedy: Remedy | None = None  # the argument of :func:`curvescan.read_log` that handles it; None where there is none
    mending: str = ""  # what a run does about it by itself, beyond doubt; empty where it only proposes the remedy

    @property
    def argument(self) -> str:
        """The remedy as it is written in Python: ``"range_max=8.1"``; empty where there is none."""
        return "" if self.remedy is None else str(self.remedy)

    @property
    def sentence(self) -> str:
        """All of it in one sentence, with what handles it: a run by itself, or an argument."""
        consequence = f": {self.consequence}" if self.consequence else ""
        handled = "; a run mends it by itself" if self.mending else f"; try {self.argument}" if self.remedy else ""
        return f"{self.what}{consequence}{handled}"


def _is_missing(r: LogReport) -> bool:
    return r.time.n_missing > _MISSING * r.time.n_sweeps


def _is_uneven(r: LogReport) -> bool:
    is_wide = r.time.step_max > _UNEVEN * r.time.step_median
    return r.time.n_equal < r.time.n_steps and is_wide and not _is_missing(r) and not r.time.n_leaps


def _is_blank(r: LogReport) -> bool:
    return r.n_scans > 0 and r.n_blank_scans == r.n_scans


_TESTS: dict[str, Callable[[LogReport], bool]] = {
    "too_few_scans": lambda r: r.n_scans < 2,
    "changing_beams": lambda r: len(r.beam_counts) > 1,
    "repeated_scans": lambda r: r.n_repeated_scans > 0,
    "stale_beams": lambda r: r.stale_share >= _STALE,
    "fixed_beams": lambda r: r.fixed_beams is not None,
    "empty_beams": lambda r: r.empty_beams is not None,
    "beams_reversed": lambda r: r.beam_order is not None and r.beam_order.is_reversed_order,
    "turns_against": lambda r: r.sense is not None and r.sense.is_reversed,
    "gyro_in_degrees": lambda r: r.sense is not None and r.sense.is_in_degrees,
    "gyro_bias": lambda r: r.gyroscope is not None and r.gyroscope.is_biased,
    "bent_sweeps": lambda r: r.gyroscope is not None and r.gyroscope.straightens,
    "equal_stamps": lambda r: 0 < r.time.n_steps == r.time.n_equal,
    "time_goes_back": lambda r: r.time.n_back > 0,
    "zero_steps": lambda r: 0 < r.time.n_equal < r.time.n_steps,
    "leaps": lambda r: r.time.n_leaps > 0,
    "missing_sweeps": _is_missing,
    "uneven_steps": _is_uneven,
    "no_beam_times": lambda r: r.n_scans > 0 and not r.n_timed_scans,
    "beam_times_too_long": lambda r: r.n_timed_scans > 0 and r.sweep_seconds > _TOO_LONG * r.time.step_median,
    "no_valid_reading": _is_blank,
    "blank_scans": lambda r: r.n_blank_scans > 0 and not _is_blank(r),
    "few_valid": lambda r: r.valid_share < _LOW_VALID_SHARE and not _is_blank(r),
    "undeclared_code": lambda r: r.suspect is not None and r.code_band is None,
    "undeclared_codes": lambda r: r.code_band is not None,
    "ring": lambda r: r.ring is not None,
    "floor": lambda r: r.floor is not None,
    "no_odometry": lambda r: r.odometry is None,
    "odometry_gaps": lambda r: r.odometry is not None and r.odometry.n_missing > 0,
    "odometry_lag": lambda r: r.odometry is not None and r.odometry.lag != 0.0,
}

_DOUBTS: dict[str, Figure] = {
    "stale_beams": lambda r: not (r.stale_share >= _CERTAINLY_STALE and r.stale_run < _SCATTERED),
    "beams_reversed": lambda r: r.beam_order.n_pairs < _MIN_ORDERED,
    "turns_against": lambda r: not r.sense.is_certainly_reversed,
}
"""Where an issue that has a mending is not beyond doubt, and its remedy is only proposed."""


def _range_limit(r: LogReport) -> float:
    """Return the limit that leaves out the codes at the top of the range, to three digits."""
    lowest = r.code_band[0] if r.code_band is not None else r.suspect.value if r.suspect is not None else 0.0
    return float(f"{0.99 * lowest:.3g}")


def _ignored_beams(r: LogReport) -> Remedy | None:
    """Return how many beams to ignore at either end: a fixed one nearer to the beginning is cut off there."""
    runs, n = r.fixed_beams or ((), 0)
    first = max((b + 1 for _, b in runs if b < n // 4), default=0)
    last = max((n - a for a, _ in runs if a >= 3 * n // 4), default=0)
    return Remedy("ignore_beams", (first, last)) if first or last else None


_REMEDIES: dict[str, Callable[[LogReport], Remedy | None]] = {
    "stale_beams": lambda _: Remedy("drop_stale", True),
    "fixed_beams": _ignored_beams,
    "beams_reversed": lambda _: Remedy("backwards", True),
    "turns_against": lambda r: Remedy("upside_down", False) if r.is_upside_down else Remedy("clockwise", True),
    "undeclared_code": lambda r: Remedy("range_max", _range_limit(r)),
    "undeclared_codes": lambda r: Remedy("range_max", _range_limit(r)),
}

_FIGURES: dict[str, Figure] = {
    "beam_counts": lambda r: ", ".join(f"{n} ({counted(k, 'scan')})" for n, k in r.beam_counts.items()),
    "fixed": lambda r: "beams " + ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in r.fixed_beams.runs),
    "or_gyroscope": lambda r: ", or the gyroscope's z axis points down" * (r.sense.reference == "gyroscope"),
    "bias_deg": lambda r: math.degrees(r.gyroscope.bias),
    "range_limit": _range_limit,
    "loose": lambda r: " that are of no surface" * r.ring.is_loose,
    "floor_deg": lambda r: math.degrees(r.floor.direction),
    "lag": lambda r: abs(r.odometry.lag),
    "late": lambda r: "late" if r.odometry.lag > 0.0 else "early",
}


class Sentences(Formatter):
    """Fills in figures: what it is called with, and those that a table makes of the first of it."""

    def __init__(self, figures: Mapping[str, Figure]) -> None:
        self._figures = figures

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        """Return what is given by that name, or a figure."""
        return kwargs[key] if key in kwargs else self._figures[str(key)](next(iter(kwargs.values())))

    def format_field(self, value: Any, format_spec: str) -> Any:
        """Return a figure as text; after "n " stands a noun that it counts."""
        is_count = format_spec.startswith("n ")
        return counted(value, format_spec[2:]) if is_count else super().format_field(value, format_spec)


def find_issues(report: LogReport) -> tuple[Issue, ...]:
    """Return what is wrong or odd with a log, each with its consequence; empty for a sound one."""
    fill = Sentences(_FIGURES).format
    issues = []
    for e in report.read_errors:
        rest = "; the rest of the log is read" * ("is read" not in e.rule)
        what = f"{e.rule}: {counted(e.count, 'time')}, first in {e.first}{rest}"
        issues.append(Issue(topic="file", kind="read_error", what=what))
    issues += [Issue(topic="file", kind="note", what=note) for note in report.notes]
    for kind, row in shipped_table(__package__, "issues.toml").items():
        if not _TESTS[kind](report):
            continue
        what, is_doubtful = fill(row["what"], r=report), kind in _DOUBTS and _DOUBTS[kind](report)
        consequence = fill(row["consequence"], r=report)
        mending = "" if is_doubtful else fill(row.get("mending", ""), r=report, what=what)
        remedy = _REMEDIES[kind](report) if kind in _REMEDIES else None
        texts = {"what": what, "consequence": consequence, "mending": mending}
        issues.append(Issue(topic=row["topic"], kind=kind, remedy=remedy, **texts))
    return tuple(issues)


def report_as_plain(report: LogReport, issues: Iterable[Issue]) -> dict[str, Any]:
    """Return a report and the issues of its log as dictionaries, lists, numbers, strings and None."""
    return {"usable": report.is_usable, "issues": [_plain(issue) for issue in issues], "report": _plain(report)}


def _plain(value: Any) -> Any:
    if isinstance(value, ReadingCode):
        is_number = math.isfinite(value.value)
        return {"value": value.value if is_number else str(value.value), "share": value.share}
    if isinstance(value, Remedy):
        return {value.argument: _plain(value.value)}
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
