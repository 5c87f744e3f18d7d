"""How long one of many matches takes: one by one, in one call, and on two processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from curvescan.benchmarks.benchmark import easy_pairs
from curvescan.matchers import match, prepare
from curvescan.matchers.many import match_many
from curvescan.runs.document import ResultTable


def measure_many(n_candidates: int = 10_000, *, n_pairs: int = 200, seed: int = 0) -> dict[str, float]:
    """Return the seconds that each of many matches of prepared scans takes, with a guess as good as odometry's.

    By how they are called: one by one, in one call, and in one call on two processes.
    """
    pairs, guesses = easy_pairs("sick-lms200", n_pairs, seed)
    rows = [k % n_pairs for k in range(n_candidates)]
    references, candidates = [prepare(p.reference) for p in pairs], [prepare(p.current) for p in pairs]
    jobs = [references[k] for k in rows], [candidates[k] for k in rows], [guesses[k] for k in rows]
    calls: dict[str, Callable[[], object]] = {
        "match, one by one": lambda: [match(ref, cur, guess=guess) for ref, cur, guess in zip(*jobs, strict=True)],
        "match_many": lambda: match_many(*jobs[:2], guess=jobs[2]),
        "match_many, two processes": lambda: match_many(*jobs[:2], guess=jobs[2], workers=2),
    }
    match_many(references[:20], candidates[:20], guess=guesses[:20])  # compiles
    seconds = {}
    for name, call in calls.items():
        started = time.perf_counter()
        call()
        seconds[name] = (time.perf_counter() - started) / n_candidates
    return seconds


def many_table(seconds: Mapping[str, float]) -> ResultTable:
    """Return the table of the times of many matches, one row a way to call them."""
    return ResultTable(
        title="Many matches of prepared scans, curvescan, good guesses: mean",
        columns=("call", "a match"),
        rows=[(call, f"{1000 * one:.3f} ms") for call, one in seconds.items()],
    )
