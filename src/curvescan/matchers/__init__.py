"""Two scans in, the pose of the second seen from the first out."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.errors import InvalidArgumentError
from curvescan.matchers.registry import DEFAULT_METHOD, MATCHERS, Matcher, MatcherConfig, Method, find_matcher
from curvescan.matchers.result import Candidate, Label, MatchResult, Outcome, prior_of
from curvescan.scan import LaserScan
from curvescan.types import UncertainPose, with_fields

__all__ = [
    "DEFAULT_METHOD", "MATCHERS", "Candidate", "Label", "MatchResult", "Matcher", "MatcherConfig", "Method",
    "Outcome", "PreparedScan", "find_matcher", "match", "prepare", "prepared",
]  # fmt: skip


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
    return prepared(scan, find_matcher(method, config), "scan")


def match(
    reference: LaserScan | PreparedScan,
    current: LaserScan | PreparedScan,
    *,
    method: Method | str = DEFAULT_METHOD,
    prior: UncertainPose | None = None,
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
    prior : UncertainPose or None
        Pose of `current` in `reference` as it is known before the match, with its covariance: from wheels, from the
        motion so far. "curvescan" weighs it with the scans, by its covariance. The baselines start at its pose; "cfsma"
        uses none. None: standing still with standard deviations of 2 m, 2 m and 2 rad.
    guess : (3,) array_like or None
        Short for a prior: the expected pose in metres, metres, radians, with standard deviations of 0.3 m, 0.3 m and
        0.2 rad. Give a prior or a guess, not both.
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
    ref, cur = prepared(reference, matcher, "reference"), prepared(current, matcher, "current")
    result = matcher.match(ref.features, cur.features, prior_of(prior, guess))
    watch.report()
    return with_fields(result, reference=ref.scan, current=cur.scan)


def prepared(scan: LaserScan | PreparedScan, matcher: Matcher, name: str) -> PreparedScan:
    """Return a scan with the features of a matcher: itself, where it has them. Raises InvalidArgumentError."""
    if isinstance(scan, PreparedScan):
        if scan.matcher is matcher:
            return scan
        scan = scan.scan
    if not isinstance(scan, LaserScan):
        raise InvalidArgumentError(f"{name} must be a LaserScan or a PreparedScan, got {type(scan).__name__}")
    return PreparedScan(scan=scan, matcher=matcher, features=matcher.prepare(scan))
