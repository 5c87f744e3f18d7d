"""FaultCounter: what is broken in a log, gathered by kind while the log is read."""

from __future__ import annotations

from curvescan.io.log import Fault


class FaultCounter:
    """Counts faults by rule and remembers the line where each was met first.

    Its size grows with the number of rules, not with the number of faults.
    """

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first_lines: dict[str, int] = {}

    def add(self, rule: str, line_number: int) -> None:
        """Count one breach of `rule`, a phrase such as ``"FLASER line cut short"``.

        Parameters
        ----------
        rule : str
            What was broken; one of a bounded set of phrases, without values taken from the line.
        line_number : int
            Number of the line in the (unpacked) file, from 1.
        """
        self._counts[rule] = self._counts.get(rule, 0) + 1
        self._first_lines.setdefault(rule, line_number)

    def faults(self) -> tuple[Fault, ...]:
        """Return one Fault a rule, most frequent first, then in the order they were met."""
        rules = sorted(self._counts, key=lambda rule: -self._counts[rule])
        return tuple(
            Fault(rule=rule, count=self._counts[rule], first=f"line {self._first_lines[rule]}")
            for rule in rules
        )
