"""Many matches in one call: each scan prepared once, the work shared out among processes of this machine."""

import itertools
import multiprocessing
import signal
import sys
import time
import warnings
from collections.abc import Iterable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.errors import InvalidArgumentError
from curvescan.matchers import PreparedScan, prepared
from curvescan.matchers.registry import DEFAULT_METHOD, Matcher, MatcherConfig, Method, find_matcher
from curvescan.matchers.result import MatchResult, prior_of
from curvescan.scan import LaserScan
from curvescan.types import UncertainPose, with_fields

_AnyScan = LaserScan | PreparedScan
_Job = tuple[PreparedScan, PreparedScan, UncertainPose | None]

_FEW = 8  # matches that are not worth a process: one takes some milliseconds to begin
_PATIENCE = 10  # times as long as the first part, and a second, is waited for another: a lock that a thread of this
# process holds as it forks stays locked in the child


def match_many(
    reference: _AnyScan | Iterable[_AnyScan],
    candidates: Iterable[_AnyScan],
    *,
    method: Method | str = DEFAULT_METHOD,
    prior: UncertainPose | Iterable[UncertainPose | None] | None = None,
    guess: ArrayLike | None = None,
    config: MatcherConfig | None = None,
    workers: int = 1,
) -> list[MatchResult]:
    """Return the pose of each candidate seen from the reference, the bits of :func:`match` one by one.

    A scan that comes more than once is prepared once.

    Parameters
    ----------
    reference : LaserScan, PreparedScan or iterable of them
        One scan for all candidates, or for each candidate its own: pairs.
    candidates : iterable of LaserScan or PreparedScan
        The scans to match, n of them; a log does as well.
    method : str
        Name of the matcher; see ``MATCHERS``.
    prior : UncertainPose, iterable of UncertainPose or None, or None
        What is known of the poses before, as in :func:`match`: one for all, or n of them, None where nothing is known.
    guess : (3,) or (n, 3) array_like or None
        Expected pose, as in :func:`match`: metres, metres, radians; one for all, or one for each. Give a prior or a
        guess, not both.
    config : dataclass, mapping or None
        The matcher's configuration, or a mapping of the fields that differ from the defaults; None for its defaults.
    workers : int
        Processes that share the matches, at least 1. They are forked, on Linux alone; elsewhere this process matches
        all. Threads gain nothing: a match holds Python's lock between its kernels.

    Returns
    -------
    list of MatchResult
        One for each candidate, in their order. ``trace`` is None. Scans that cannot be matched give a result with a
        reason, never an exception.

    Raises
    ------
    InvalidArgumentError
        When an argument is not of the kinds above, or there are not as many references or priors as candidates.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise InvalidArgumentError(f"workers must be a whole number of at least 1, got {workers!r}")
    matcher = find_matcher(method, config)
    scans = _listed(candidates, "candidates")
    is_one = isinstance(reference, LaserScan | PreparedScan)
    references = [reference] * len(scans) if is_one else _listed(reference, "reference", len(scans))
    priors = _priors(prior, guess, len(scans))
    once = _Once(matcher)
    jobs = [
        (once.prepared(ref, "reference"), once.prepared(cur, "candidates"), known)
        for ref, cur, known in zip(references, scans, priors, strict=True)
    ]
    results = _shared_out(matcher, jobs, workers)
    watch.report()
    return results


class _Once:
    """Prepares each scan once, however often it comes."""

    def __init__(self, matcher: Matcher) -> None:
        self._matcher = matcher
        self._known: dict[int, PreparedScan] = {}

    def prepared(self, scan: _AnyScan, name: str) -> PreparedScan:
        if id(scan) not in self._known:
            self._known[id(scan)] = prepared(scan, self._matcher, name)
        return self._known[id(scan)]


def _matched(matcher: Matcher, jobs: list[_Job], *, has_scans: bool = True) -> list[MatchResult]:
    """Return the results of some jobs, without traces, which hold much."""
    return [
        with_fields(
            matcher.match(ref.features, cur.features, prior),
            reference=ref.scan if has_scans else None,
            current=cur.scan if has_scans else None,
            trace=None,
        )
        for ref, cur, prior in jobs
    ]


def _listed(value: Any, name: str, n: int | None = None) -> list[Any]:
    """Return what an iterable holds; refuse anything else, and another number than `n`."""
    if isinstance(value, LaserScan | PreparedScan | str) or not isinstance(value, Iterable):
        raise InvalidArgumentError(f"{name} must be several, as a list or a log, got {type(value).__name__}")
    listed = list(value)
    if n is not None and len(listed) != n:
        raise InvalidArgumentError(f"{name} must be one for all {n} candidates or one for each, got {len(listed)}")
    return listed


def _priors(prior: Any, guess: ArrayLike | None, n: int) -> list[UncertainPose | None]:
    """Return what is known before each of n matches, checked."""
    if prior is None or isinstance(prior, UncertainPose):
        if guess is None or np.ndim(guess) != 2:
            return [prior_of(prior, guess)] * n
        guesses = _listed(guess, "guess", n)
        return [prior_of(prior, one, f"guess[{k}]") for k, one in enumerate(guesses)]
    return [prior_of(one, guess, f"prior[{k}]") for k, one in enumerate(_listed(prior, "prior", n))]


def _shared_out(matcher: Matcher, jobs: list[_Job], workers: int) -> list[MatchResult]:
    """Return the results of all jobs, the first part made here and the others in forked processes.

    What a process does not bring back is made here.
    """
    n = min(workers, len(jobs) // _FEW) if sys.platform == "linux" else 1
    if n < 2:
        return _matched(matcher, jobs)
    bounds = np.linspace(0, len(jobs), n + 1).astype(int).tolist()
    parts = [jobs[low:high] for low, high in itertools.pairwise(bounds)]
    children = [_forked(matcher, part) for part in parts[1:]]
    try:
        begin = time.monotonic()
        results = _matched(matcher, parts[0])
        patience = 1.0 + _PATIENCE * (time.monotonic() - begin)
        for (_, pipe), part in zip(children, parts[1:], strict=True):
            results += _received(pipe, part, patience) or _matched(matcher, part)
    finally:
        for process, pipe in children:
            process.terminate()
            process.join()
            pipe.close()
    return results


def _forked(matcher: Matcher, part: list[_Job]) -> tuple[Any, Connection]:
    """Return a process that inherits a part of the jobs, and the pipe on which it sends their results."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(theirs, matcher, part), daemon=True)
    with warnings.catch_warnings():
        # of threads in this process: a child that waits for one of their locks is given up
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    theirs.close()
    return process, ours


def _send(pipe: Connection, matcher: Matcher, part: list[_Job]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is told as well, and ends this process
    pipe.send(_matched(matcher, part, has_scans=False))


def _received(pipe: Connection, part: list[_Job], patience: float) -> list[MatchResult]:
    """Return the results of a process, with their scans; none if it ended or sent none within `patience` seconds."""
    try:
        if not pipe.poll(patience):
            return []
        results = pipe.recv()
    except (EOFError, OSError):
        return []
    return [
        with_fields(one, reference=ref.scan, current=cur.scan) for one, (ref, cur, _) in zip(results, part, strict=True)
    ]
