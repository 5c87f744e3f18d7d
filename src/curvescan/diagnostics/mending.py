"""mend: a log without what is wrong with it beyond doubt.

A check (:mod:`curvescan.diagnostics.checks`) whose evidence leaves no doubt says what is done about it; the rest is proposed.
What a user has set up by hand is left as it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from curvescan.diagnostics.inspect import inspect_log
from curvescan.diagnostics.issues import Issue, find_issues
from curvescan.diagnostics.report import LogReport
from curvescan.diagnostics.sensor import judge_sensor
from curvescan.io.held import HeldLog
from curvescan.io.log import Log, LogView
from curvescan.io.sensor_setup import SensorSetup, apply_setup, setup_of
from curvescan.scan import LaserScan
from curvescan.types import Floats

_ROUNDS = 3
"""Most inspections: what is mended first can hide what is mended next."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mended:
    """A log after :func:`mend`.

    Attributes
    ----------
    log : Log
        The log without the faults; the log itself where nothing was mended.
    done : tuple of Issue
        What was mended; ``mending`` of each says how.
    issues : tuple of Issue
        What is still wrong or odd with it.
    report : LogReport
        What is in it now.
    """

    log: Log
    done: tuple[Issue, ...]
    issues: tuple[Issue, ...]
    report: LogReport

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended, a sentence each."""
        return tuple(f"{issue.mending}; as_is=True keeps them" for issue in self.done)


def mend(log: Log, *, as_is: bool = False, is_order_needed: bool = True) -> Mended:
    """Return a log without what is wrong with it beyond doubt: codes for no return, stale beams, turned or mirrored beams.

    Parameters
    ----------
    log : Log
        Any log.
    as_is : bool
        Whether to mend nothing, and only say what is wrong.
    is_order_needed : bool
        Whether to find out in which order the beams were swept, which takes a second: sweeps are deskewed by it.
    """
    done: tuple[Issue, ...] = ()
    given = setup_of(log)
    for _ in range(_ROUNDS):
        report = inspect_log(log, judge_sensor(log, is_order_needed=is_order_needed))
        issues = find_issues(report)
        faults = [i for i in issues if i.mending and not _is_set(given, i) and i.kind not in {d.kind for d in done}]
        if as_is or not faults:
            break
        log, done = HeldLog(_without(log, faults)), (*done, *faults)
    return Mended(log=log, done=done, issues=issues, report=report)


def _is_set(given: SensorSetup, fault: Issue) -> bool:
    """Return whether the user has set by hand what the remedy of a fault would set."""
    name = "" if fault.remedy is None else fault.remedy.argument
    if name in ("clockwise", "upside_down"):
        return given.clockwise or given.upside_down is not None
    return bool(getattr(given, name, False))


def _without(log: Log, faults: list[Issue]) -> Log:
    """Return a log with the remedies of its faults applied."""
    remedies = dict(fault.remedy for fault in faults if fault.remedy is not None)
    range_max = remedies.pop("range_max", None)
    is_mirrored = bool(remedies.pop("clockwise", False)) or "upside_down" in remedies
    in_degrees = any(fault.kind == "gyro_in_degrees" for fault in faults)
    if range_max is not None or in_degrees:
        log = _Limited(log, range_max, in_degrees=in_degrees)
    setup = SensorSetup(
        upside_down=False,
        clockwise=is_mirrored,
        drop_stale=bool(remedies.get("drop_stale", False)),
        backwards=bool(remedies.get("backwards", False)),
    )
    return apply_setup(log, setup)


class _Limited(LogView):
    """A log whose readings end at a limit, and whose gyroscope may give degrees; a Log."""

    def __init__(self, log: Log, range_max: object, *, in_degrees: bool) -> None:
        super().__init__(log)
        self._range_max = range_max if isinstance(range_max, float) else np.inf
        self._in_degrees = in_degrees

    def turned_by_gyro(self) -> Floats | None:
        """Return the angle that the gyroscope has turned by at each scan, radians."""
        turned = super().turned_by_gyro()
        return np.radians(turned) if turned is not None and self._in_degrees else turned

    def __iter__(self) -> Iterator[LaserScan]:
        return map(self._limited, self._log)

    def _scan_at(self, i: int) -> LaserScan:
        return self._limited(self._log[i])

    def _limited(self, scan: LaserScan) -> LaserScan:
        return replace(scan, range_max=self._range_max) if scan.range_max > self._range_max else scan
