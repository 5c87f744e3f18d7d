"""A report as plain values for JSON: the same keys for every log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from curvescan.diagnostics.issues import Remedy, find_issues
from curvescan.diagnostics.report import LogReport, ReadingCode


def report_as_plain(report: LogReport) -> dict[str, Any]:
    """Return a report and its issues as dictionaries, lists, numbers, strings and None."""
    return {
        "usable": report.is_usable,
        "issues": [_plain(issue) for issue in find_issues(report)],
        "report": _plain(report),
    }


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
