"""Diagnosis: the node's report once a second: outcomes, times, and what is missing when no scan comes."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR, STALE = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
SILENT = 1.0
"""After so long without a scan something is missing, seconds."""


class Diagnosis:
    """Counts what happens between two reports."""

    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()
        self._milliseconds: deque[float] = deque(maxlen=400)
        self.n_scans = self.n_refused = self.n_lost = self.n_unmatched = 0
        self.n_closures = 0
        self._recent_unmatched: deque[bool] = deque(maxlen=20)
        self.direction: np.ndarray | None = None
        self.last_refusal = ""
        self.last_scan_at: float | None = None

    def add(self, tracked: object, now: float) -> None:
        """Count a tracked scan."""
        self.n_scans += 1
        self.outcomes[tracked.step.outcome.name.lower()] += 1
        self._milliseconds.append(1e3 * tracked.seconds)
        self._recent_unmatched.append(not tracked.step.is_matched and tracked.index > 0)
        self.n_unmatched += self._recent_unmatched[-1]
        self.n_closures += len(tracked.closures)
        self.direction = getattr(tracked.step.match, "degenerate_direction", None)
        self.last_scan_at = now

    def refuse(self, why: str) -> None:
        """Count a message that is no scan."""
        self.n_refused += 1
        self.last_refusal = why

    def status(self, now: float, missing: str) -> DiagnosticStatus:
        """Return the report; `missing` says why no scan comes, if none does."""
        level, text = self._verdict(now, missing)
        status = DiagnosticStatus(level=level, name="curvescan", message=text, hardware_id="")
        milliseconds = np.array(self._milliseconds or [0.0])
        values: dict[str, object] = {
            "scans": self.n_scans,
            "lost by the middleware": self.n_lost,
            "refused": self.n_refused,
            "loop closures": self.n_closures,
            "ms a scan, median": f"{np.median(milliseconds):.2f}",
            "ms a scan, worst": f"{milliseconds.max():.2f}",
            "degenerate direction": "none" if self.direction is None else ", ".join(f"{v:.2f}" for v in self.direction),
        } | {f"outcome {name}": count for name, count in self.outcomes.items()}
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return status

    def _verdict(self, now: float, missing: str) -> tuple[bytes, str]:
        if self.last_scan_at is None or now - self.last_scan_at > SILENT:
            return (STALE if self.n_scans else ERROR), missing
        share = sum(self._recent_unmatched) / max(len(self._recent_unmatched), 1)
        if share > 0.5:
            return ERROR, "most scans are not matched: the motion is a guess"
        if share > 0.0:
            return WARN, "some scans are not matched"
        if self.direction is not None:
            return WARN, "a direction of the motion is unobservable here"
        if self.n_refused:
            return WARN, f"{self.n_refused} messages were refused: {self.last_refusal}"
        return OK, "tracking"
