"""The words of a day for how the track stands: Tracking, Not sure, Lost."""

from __future__ import annotations

_UNSURE = frozenset({"predicted"})
_LOST = frozenset({"held", "lost", "searching"})


def status_of(outcome: str, *, is_degenerate: bool = False) -> tuple[str, str]:
    """Return the tone of a colour and the word for the outcome, by its name, of a scan."""
    if outcome.lower() in _LOST:
        return "bad", "Lost"
    if is_degenerate or outcome.lower() in _UNSURE:
        return "warn", "Not sure"
    return "good", "Tracking"
