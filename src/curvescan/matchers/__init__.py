"""Two scans in, the pose of the second seen from the first out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.errors import InvalidArgumentError
from curvescan.matchers.registry import DEFAULT_METHOD, MATCHERS, Matcher, MatcherConfig, Method, find_matcher
from curvescan.matchers.result import Label, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.types import Pose

__all__ = [
    "DEFAULT_METHOD",
    "MATCHERS",
    "Label",
    "MatchResult",
    "Matcher",
    "MatcherConfig",
    "Method",
    "Outcome",
    "PreparedScan",
    "find_matcher",
    "match",
    "prepare",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class PreparedScan:
    """A scan with all that one matcher computes from it alone, to be matched any number of times.

    Attributes
    ----------
    scan : LaserScan
        The scan itself.
    matcher : Matcher
        Whose features these are.
    features : object
        The matcher's own record, ``CurvescanFeatures`` for "curvescan", ``CfSmaFeatures`` for "cfsma".
    """

    scan: LaserScan
    matcher: Matcher
    features: Any

    def __repr__(self) -> str:
        kind = type(self.matcher).__name__.removesuffix("Matcher")
        return f"PreparedScan({self.scan!r} with the features of {kind})"


def prepare(
    scan: LaserScan, *, method: Method | str = DEFAULT_METHOD, config: MatcherConfig | None = None
) -> PreparedScan:
    """Return a scan with its features computed, ready to be matched as reference and as current scan.

    Parameters
    ----------
    scan : LaserScan
        Any scan, also one without valid readings.
    method : str
        Name of the matcher.
    config : dataclass, mapping or None
        The matcher's configuration, or a mapping of the fields that differ from the defaults, nested as its classes
        are; None for the defaults.

    Raises
    ------
    InvalidArgumentError
        When `scan` is not a LaserScan, the method is unknown or the config is another method's.
    """
    return _prepared(scan, find_matcher(method, config), "scan")


def match(
    reference: LaserScan | PreparedScan,
    current: LaserScan | PreparedScan,
    *,
    method: Method | str = DEFAULT_METHOD,
    guess: ArrayLike | None = None,
    config: MatcherConfig | None = None,
) -> MatchResult:
    """Return the pose of `current` seen from `reference`, with its covariance.

    Parameters
    ----------
    reference : LaserScan or PreparedScan
        The earlier scan. One prepared for another method or configuration is prepared anew.
    current : LaserScan or PreparedScan
        The later scan.
    method : str
        Name of the matcher; see ``MATCHERS``.
    guess : (3,) array_like or None
        Expected pose of `current` in `reference`: metres, metres, radians. Only a help: "curvescan" needs none, is
        faster with a good one and no worse with a wrong one, and follows it along a direction that the scans leave
        open; "cfsma" uses none.
    config : dataclass, mapping or None
        The matcher's configuration (``cs.CurvescanConfig`` for "curvescan"), or a mapping of the fields that differ
        from the defaults: ``{"refinement": {...}}``; None for its defaults.

    Returns
    -------
    MatchResult
        ``ok`` is True when there is a pose, ``outcome`` is how it ended. Scans that cannot be matched give a
        result with a reason, never an exception.

    Raises
    ------
    InvalidArgumentError
        When an argument is not of the kinds above.
    """
    matcher = find_matcher(method, config)
    ref, cur = _prepared(reference, matcher, "reference"), _prepared(current, matcher, "current")
    result = matcher.match(ref.features, cur.features, None if guess is None else _as_guess(guess))
    watch.report()
    return replace(result, reference=ref.scan, current=cur.scan)


def _prepared(scan: LaserScan | PreparedScan, matcher: Matcher, name: str) -> PreparedScan:
    if isinstance(scan, PreparedScan):
        if scan.matcher is matcher:
            return scan
        scan = scan.scan
    if not isinstance(scan, LaserScan):
        raise InvalidArgumentError(f"{name} must be a LaserScan or a PreparedScan, got {type(scan).__name__}")
    return PreparedScan(scan=scan, matcher=matcher, features=matcher.prepare(scan))


_MAX_GUESS = 1e6  # metres, radians: no laser sees as far


def _as_guess(guess: ArrayLike) -> Pose:
    try:
        pose = np.asarray(guess, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"guess must be three numbers [x, y, theta]: {error}") from error
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InvalidArgumentError(f"guess must be three finite numbers [x, y, theta], got {guess!r}")
    if np.abs(pose).max() > _MAX_GUESS:
        raise InvalidArgumentError(
            f"guess must lie within {_MAX_GUESS:g} m, its angle within as many radians: leave it out where there is "
            f"none, got {guess!r}"
        )
    return pose
