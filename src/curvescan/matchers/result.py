"""What goes into a match and what comes out: the prior, checked, and the result with its outcome."""

import math
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.scan import LaserScan
from curvescan.se2 import is_positive_definite, wrap
from curvescan.types import Codes, Cov, Floats, Pose, UncertainPose, three_numbers

GUESS_SIGMA = (0.3, 0.3, 0.2)  # standard deviations that a bare guess stands for: metres, metres, radians

WIDE_SIGMA = (2.0, 2.0, 2.0)
"""Standard deviations about standing still that hold where nothing is known: metres, metres, radians."""

WIDE_PRIOR = UncertainPose(np.zeros(3), np.diag(np.square(WIDE_SIGMA)))
GUESS_COVARIANCE = np.diag(np.square(GUESS_SIGMA))
GUESS_COVARIANCE.setflags(write=False)

_MAX = 1e6  # metres, radians: no laser sees as far
_ASYMMETRY = 1e-9  # of the greatest element: what rounding leaves


def prior_of(prior: UncertainPose | None, guess: ArrayLike | None, name: str = "") -> UncertainPose | None:
    """Return what two arguments say is known before a match, checked; None for nothing. Raises InvalidArgumentError."""
    if guess is not None:
        if prior is not None:
            raise InvalidArgumentError("prior and guess say the same: give one of them")
        return UncertainPose(_as_pose(guess, name or "guess"), GUESS_COVARIANCE)
    return None if prior is None else known_pose(prior, name or "prior")


def known_pose(prior: UncertainPose, name: str) -> UncertainPose:
    """Return a pose with its covariance, checked. Raises InvalidArgumentError."""
    if not isinstance(prior, UncertainPose):
        raise InvalidArgumentError(f"{name} must be an UncertainPose(pose, covariance), got {type(prior).__name__}")
    pose = _as_pose(prior.pose, f"{name}.pose")
    try:
        cov = np.asarray(prior.covariance, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name}.covariance must be a (3, 3) matrix of numbers: {error}") from error
    # plain numbers, as in `_as_pose`
    if cov.shape != (3, 3) or not all(map(math.isfinite, numbers := cov.ravel().tolist())):
        raise InvalidArgumentError(f"{name}.covariance must be (3, 3) and finite, got {prior.covariance!r}")
    asymmetry = max(abs(numbers[i] - numbers[j]) for i, j in ((1, 3), (2, 6), (5, 7)))
    if asymmetry > _ASYMMETRY * max(*map(abs, numbers), _ASYMMETRY):
        raise InvalidArgumentError(f"{name}.covariance must be symmetric, got {prior.covariance!r}")
    if not is_positive_definite(cov):
        raise InvalidArgumentError(
            f"{name}.covariance must be positive definite, its least eigenvalue is {np.linalg.eigvalsh(cov)[0]:g}: "
            "where something is known exactly, give it a small variance"
        )
    return UncertainPose(pose, cov)


def _as_pose(value: ArrayLike, name: str) -> Pose:
    pose = three_numbers(value, f"{name} must be three finite numbers [x, y, theta]")
    if max(map(abs, pose.tolist())) > _MAX:
        raise InvalidArgumentError(
            f"{name} must lie within {_MAX:g} m, its angle within as many radians: leave it out where there is "
            f"none, got {value!r}"
        )
    return pose if abs(pose[2]) <= math.pi else np.append(pose[:2], wrap(pose[2]))


def log_odds(confidence: float, unknown: float = 0.0) -> float:
    """Return the log odds of a match by its confidence, 1 in a million at the most; `unknown` of one without."""
    return unknown if math.isnan(confidence) else math.log(max(confidence, 1e-6) / max(1.0 - confidence, 1e-6))


def slip_odds(off: Floats, distance: float) -> float:
    """Return the log odds against a motion that slipped by (2,) off, for a match that errs: anywhere along there.

    distance: squared, by what the motion is known to. Slips have a heavy tail: Student's t of three degrees of freedom.
    """
    ratio = math.hypot(*off.tolist()) * (1.0 + distance / 3) ** 2 / (WIDE_SIGMA[0] * math.sqrt(distance))
    return math.log(ratio) if ratio > 0.0 else -math.inf


class Outcome(Enum):
    """How a match ended; the value is a sentence for people."""

    MATCHED = "The scans match."
    NO_SEGMENTS = "A scan has no segment: too few valid readings, or only isolated groups of them."
    NO_COMMON_FUNCTION = "No curvature functions of the two scans correlate enough."
    NO_LANDMARKS = "What the scans have in common shows no corner in both: it is straight or smooth."
    DISSIMILAR_LANDMARKS = "No corners of the scans' common segments look alike."
    AMBIGUOUS_LANDMARKS = "Corners look alike, but more than one pairing of them is as good."
    NO_LINES = "The reference has no straight line that is long enough."
    TOO_FEW_PAIRS = "Too few readings of the scans come close to each other to carry a pose."
    NO_AGREEMENT = "The histograms of the scans have no clear best agreement near the guess."
    UNCONSTRAINED = "What the scans share leaves a motion free, as one wall or a round room does."
    NOT_CONVERGED = "The iteration did not settle within its limit."
    DEGENERATE = "The matched points lie in one place and fix no rotation."
    UNSUPPORTED = "At no pose do enough readings of the two scans agree."
    AMBIGUOUS = "Two poses that differ explain the scans nearly as well as each other."


class Label(IntEnum):
    """What a reading did in a match."""

    NO_READING = 0
    """The beam has no valid reading."""
    UNMATCHED = 1
    """The reading took no part in the pose."""
    MATCHED = 2
    """The reading has a partner in the other scan (a reading, a line, a peak), and the pose stands on it."""
    DYNAMIC = 3
    """The reading lies where the other scan saw through: what it hit has come or gone."""
    NEW = 4
    """The reading lies out of the other scan's sight: behind something, or outside its field of view."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """One of the poses that may be the right one.

    Attributes
    ----------
    pose : (3,) float64
        [x, y, theta] of `current` in the frame of `reference`: metres, metres, radians. Where the scans leave a
        direction open it is the place along it at which they agree best, wherever the prior is.
    log_odds : float
        Logarithm of the odds that this pose is right against the scans having nothing in common, given the prior; NaN
        for matchers that do not compute it.
    information : (3, 3) float64
        Of the scans alone at this pose, order x, y, theta: 1/m^2, 1/(m rad), 1/rad^2. Zero along what they leave open;
        where they agree nearly as well all along it, and yet best at one place, that place has a standard deviation
        of 0.1 m. That place is a hypothesis: it is now and then wrong, and other scans must confirm it. Without a
        prior, one of several such places counts by how far they lie apart.
    covariance : (3, 3) float64
        The inverse of `information`, with a standard deviation of 1 m along what the scans leave open.
    degenerate_direction : (3,) float64 or None
        The direction in which the scans agree nearly as well, as in MatchResult; None where all of the pose is fixed.
    n_matched : int
        Pairs of readings that agree at this pose.
    """

    pose: Pose
    log_odds: float
    information: Cov
    covariance: Cov
    degenerate_direction: Floats | None = None
    n_matched: int = 0

    def __repr__(self) -> str:
        x, y, theta = (float(value) for value in self.pose)
        return f"Candidate(x={x:.3f} m, y={y:.3f} m, theta={theta:.3f} rad, log odds {self.log_odds:.1f})"


@dataclass(frozen=True, eq=False, kw_only=True)
class MatchResult:
    """Pose of the current scan seen from the reference, its covariance, and what each reading did.

    Attributes
    ----------
    method : str
        Name of the matcher.
    outcome : Outcome
        How it ended.
    pose : (3,) float64
        [x, y, theta] of `current` in the frame of `reference`: metres, metres, radians in (-pi, pi];
        NaN unless `ok`.
    covariance : (3, 3) float64
        Covariance of the pose in the order x, y, theta: m^2, m rad, rad^2. Symmetric and positive definite
        when `ok`, NaN otherwise.
    n_matched : int
        Pairs of readings that the pose stands on (N_t of the paper); 0 unless `ok`.
    trace : object
        What the matcher did on the way: a record of its own, ``CurvescanTrace`` for "curvescan", ``CfSmaTrace`` for
        "cfsma", ``IterationTrace`` for the iterated methods, ``HistogramTrace`` for "histogram".
    labels_reference, labels_current : (n_beams,) uint8
        A Label for each beam of the two scans, in the order of their own ranges.
    degenerate_direction : (3,) float64 or None
        The change of pose, x, y and theta in metres and radians, that the scans leave open: along a corridor, about
        the centre of a round room. It moves a typical reading by a metre. The covariance is wide along it. None
        where all of the pose is fixed, and for matchers that do not compute it.
    score, runner_up : float
        How well the scans agree at the pose, and at the best pose that is another, at most 1; NaN where there is
        none and for matchers that do not compute it.
    confidence : float
        Probability, 0 to 1, that the pose is right within what its covariance says, given the prior: calibrated on
        several generators of places and on real logs. Of 100 matches with 0.99 about 99 are right. At most 0.9 where
        half a turn would look the same, or all that fixes the pose may have moved. 0 without a pose; NaN for matchers
        that do not compute it. Two matches of one pair of places err together: do not multiply their confidences.
    candidates : tuple of Candidate
        The poses that may be right, at most five, most likely first; also of a match that failed as several may be.
        Empty where no pose explains the scans. The first may differ from `pose` along a direction that is open.
    information : (3, 3) float64
        What the scans alone say at `pose`, or without one at the first candidate, without the prior: order x, y,
        theta; 1/m^2, 1/(m rad), 1/rad^2. Zero along what they leave open, and zero where no pose explains them. Made
        to be fused with the prior.
    is_guess_decisive : bool
        Whether several poses explain the scans and the guess decided between them: the pose is then as good as the
        guess.
    reference, current : LaserScan or None
        The scans, for figures; None in the results within an odometry, which are kept by the thousand.
    """

    method: str
    outcome: Outcome
    pose: Pose
    covariance: Cov
    n_matched: int
    trace: object
    labels_reference: Codes
    labels_current: Codes
    degenerate_direction: Floats | None = None
    score: float = math.nan
    runner_up: float = math.nan
    confidence: float = math.nan
    candidates: tuple[Candidate, ...] = ()
    information: Cov = field(default_factory=lambda: np.zeros((3, 3)))
    is_guess_decisive: bool = False
    reference: LaserScan | None = None
    current: LaserScan | None = None

    def __post_init__(self) -> None:
        """Fill in what follows from the covariance for matchers that compute nothing more."""
        if self.ok and not self.candidates:
            information, direction = np.linalg.pinv(self.covariance, hermitian=True), self.degenerate_direction
            if direction is not None:
                along = information @ direction
                information = information - np.outer(along, along) / float(direction @ along)
            object.__setattr__(self, "information", 0.5 * (information + information.T))
            only = Candidate(
                pose=self.pose,
                log_odds=math.nan,
                information=self.information,
                covariance=self.covariance,
                degenerate_direction=direction,
                n_matched=self.n_matched,
            )
            object.__setattr__(self, "candidates", (only,))

    @property
    def ok(self) -> bool:
        """Whether the match found a pose."""
        return self.outcome is Outcome.MATCHED

    def __repr__(self) -> str:
        if not self.ok:
            return f"MatchResult({self.method}: {self.outcome.value})"
        x, y, theta = self.pose
        sigma = np.sqrt(np.diag(self.covariance))
        return (
            f"MatchResult({self.method}: x={x:.4f}±{sigma[0]:.4f} m, y={y:.4f}±{sigma[1]:.4f} m, "
            f"theta={theta:.4f}±{sigma[2]:.4f} rad, {self.n_matched} matched)"
        )


NO_POSE, NO_COVARIANCE, NO_INFORMATION = np.full(3, np.nan), np.full((3, 3), np.nan), np.zeros((3, 3))
for _nothing in (NO_POSE, NO_COVARIANCE, NO_INFORMATION):
    _nothing.setflags(write=False)
