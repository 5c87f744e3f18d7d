"""The matcher "histogram": rotation from angle histograms, translation from x and y histograms.

G. Weiss, E. v. Puttkamer, "A map based on laserscans without geometric interpretation", Intelligent Autonomous
Systems 4 (1995); the line filter by J.-S. Gutmann and C. Schlegel, "AMOS: comparison of scan matching approaches
for self-localization in indoor environments", EUROBOT 1996.
"""

import math
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import HistogramConfig
from curvescan.matchers.baselines.iteration import is_constrained, jacobian
from curvescan.matchers.baselines.lines import extract_lines
from curvescan.matchers.baselines.outcome_checks import failure, has_surfaces, start
from curvescan.matchers.baselines.points import ScanPoints, sweep_of
from curvescan.matchers.cfsma.trace import labels_of
from curvescan.matchers.result import MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Floats, Ints, Points, Pose

_ANGLE_SMOOTHING = math.radians(2.0)  # standard deviation of the noise of a tangent, radians
_BIN_WIDTH = 0.02  # of the x and y histograms, metres
_MAX_TRANSLATION = 1.0  # translations farther from the guess, along either axis, are not looked at, metres


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Where two histograms agree best."""

    lag: float  # bins by which the second must be moved up to agree with the first, between bins by a parabola
    agreement: float  # correlation coefficient there, 0 to 1
    width: float  # standard deviation of the peak taken as a bell, bins; inf where it is no peak


def ring_histogram(positions: Floats, weights: Floats, n_bins: int, smoothing: float) -> Floats:
    """Return a (n_bins,) histogram on a ring, each weighted entry shared by two bins, smoothed by a bell."""
    lower = np.floor(positions)
    share = positions - lower
    bins = lower.astype(np.int64) % n_bins
    histogram = np.bincount(bins, weights * (1.0 - share), n_bins)
    histogram += np.bincount((bins + 1) % n_bins, weights * share, n_bins)
    frequencies = np.arange(n_bins // 2 + 1) * (2.0 * math.pi / n_bins)
    bell = np.exp(-0.5 * (smoothing * frequencies) ** 2)
    return np.fft.irfft(np.fft.rfft(histogram) * bell, n_bins)


def best_lag(first: Floats, second: Floats, centre: float, reach: float) -> Peak | None:
    """Return the lag within a window at which two (n,) histograms agree best; None where empty or at the border."""
    n = first.size
    norm = math.sqrt(float(first @ first) * float(second @ second))
    if norm <= 0.0:
        return None
    correlation = np.fft.irfft(np.fft.rfft(first) * np.conj(np.fft.rfft(second)), n)
    reach = min(reach, n / 2 - 1)
    lags = np.arange(math.ceil(centre - reach), math.floor(centre + reach) + 1)
    values = correlation[lags % n]
    best = int(np.argmax(values))
    before, top, after = correlation[(lags[best] + np.array([-1, 0, 1])) % n]
    if max(before, after) > top:
        return None
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return Peak(
        lag=float(lags[best] + shift),
        agreement=float(top / norm),
        width=math.sqrt(-top / bend) if bend < 0.0 else math.inf,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class HistogramFeatures:
    """What the histograms are made of."""

    points: ScanPoints  # the scan
    on_line: Ints  # (n,): its readings that pass the line filter
    angles: Floats  # (n,): direction of their tangents, radians
    angle_histogram: Floats  # (angle_bins,): smoothed histogram of these


@dataclass(frozen=True, kw_only=True)
class HistogramTrace:
    """The three peaks, None where there was none; main_direction in radians, frame ref."""

    main_direction: float
    rotation: Peak | None
    x: Peak | None = None
    y: Peak | None = None


class HistogramMatcher:
    """Angle histograms turn the scans to each other, x and y histograms along the main direction shift them.

    Departure: a tangent is fitted to the readings within 0.15 m, not drawn from one reading to the next, whose noise
    turns it by tens of degrees near the sensor.

    Departure: a reading counts in the x histogram by how much its surface faces x (its normal's x, squared), so that
    a wall along x does not fill that histogram with its length, as T. Röfer, "Using histogram correlation to create
    consistent laser scan maps", IROS 2002, does. A corridor is then determined by its few doors, or not at all.
    """

    def __init__(self, config: HistogramConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> HistogramFeatures:
        """Return the tangent angles of a scan's lines and their histogram."""
        config = self.config
        points = sweep_of(scan)
        lines = extract_lines(points, config.lines)
        on_line = lines.readings(points, np.arange(len(lines)))
        angles = np.arctan2(points.tangents[on_line, 1], points.tangents[on_line, 0])
        step = 2.0 * math.pi / config.angle_bins
        histogram = ring_histogram(angles / step, np.ones(angles.size), config.angle_bins, _ANGLE_SMOOTHING / step)
        return HistogramFeatures(points=points, on_line=on_line, angles=angles, angle_histogram=histogram)

    def can_be_reference(self, features: HistogramFeatures) -> bool:
        """Return whether the scan has a line."""
        return features.on_line.size > 0

    def match(
        self, reference: HistogramFeatures, current: HistogramFeatures, prior: UncertainPose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`, looked for around the pose of the prior."""

        def failed(outcome: Outcome, trace: HistogramTrace | None = None) -> MatchResult:
            return failure("histogram", outcome, reference.points, current.points, trace)

        if not (has_surfaces(reference.points) and has_surfaces(current.points)):
            return failed(Outcome.NO_SEGMENTS)
        if reference.on_line.size == 0 or current.on_line.size == 0:
            return failed(Outcome.NO_LINES)
        expected, step = start(prior), 2.0 * math.pi / self.config.angle_bins
        # the direction that most surfaces run in
        main = int(np.argmax(reference.angle_histogram)) * 2.0 * math.pi / reference.angle_histogram.size
        reach = self.config.max_rotation / step
        rotation = best_lag(reference.angle_histogram, current.angle_histogram, expected[2] / step, reach)
        trace = HistogramTrace(main_direction=main, rotation=rotation)
        if rotation is None:
            return failed(Outcome.NO_AGREEMENT, trace)
        theta = rotation.lag * 2.0 * math.pi / self.config.angle_bins
        x, y = self._translation(reference, current, main, theta, expected)
        trace = HistogramTrace(main_direction=main, rotation=rotation, x=x, y=y)
        least = self.config.min_agreement
        if x is None or y is None or min(x.agreement, y.agreement) < least:
            return failed(Outcome.NO_AGREEMENT, trace)
        shift = _BIN_WIDTH * np.array([x.lag, y.lag])
        pose = np.append(se2.rotation(main) @ shift, se2.wrap(theta))
        points, angles = current.points.points[current.on_line], current.angles + theta
        rows = jacobian(points, np.stack([-np.sin(angles), np.cos(angles)], axis=1), pose)
        if not is_constrained(rows, points):
            return failed(Outcome.UNCONSTRAINED, trace)
        return MatchResult(
            method="histogram",
            outcome=Outcome.MATCHED,
            pose=pose,
            covariance=_covariance((x, y, rotation), (_BIN_WIDTH, _BIN_WIDTH, step), theta, main, points, angles),
            n_matched=current.on_line.size,
            trace=trace,
            labels_reference=labels_of(reference.points.n_beams, reference.points.beam_idx, reference.on_line),
            labels_current=labels_of(current.points.n_beams, current.points.beam_idx, current.on_line),
        )

    def _translation(
        self, reference: HistogramFeatures, current: HistogramFeatures, main: float, theta: float, expected: Pose
    ) -> tuple[Peak | None, Peak | None]:
        """Return the peaks of the x and y histograms, axes along the main direction of the reference."""
        ref = reference.points.points[reference.on_line] @ se2.rotation(main)
        cur = current.points.points[current.on_line] @ se2.rotation(main - theta)
        ref_facing = _facing(reference.angles - main)
        cur_facing = _facing(current.angles + theta - main)
        centre = expected[:2] @ se2.rotation(main) / _BIN_WIDTH
        # a ring long enough that nothing meets itself around it
        length = 2.0 * (np.abs(ref).max() + np.abs(cur).max()) + _MAX_TRANSLATION
        n_bins = 1 << math.ceil(math.log2(length / _BIN_WIDTH + 2.0))
        smoothing, reach = self.config.smoothing / _BIN_WIDTH, _MAX_TRANSLATION / _BIN_WIDTH

        def peak(axis: int) -> Peak | None:
            first = ring_histogram(ref[:, axis] / _BIN_WIDTH, ref_facing[:, axis], n_bins, smoothing)
            second = ring_histogram(cur[:, axis] / _BIN_WIDTH, cur_facing[:, axis], n_bins, smoothing)
            return best_lag(first, second, centre[axis], reach)

        return peak(0), peak(1)


def _covariance(
    peaks: tuple[Peak, Peak, Peak],
    widths: tuple[float, float, float],
    theta: float,
    main: float,
    points: Points,
    angles: Floats,
) -> Cov:
    """Return the covariance from the widths of the peaks of x, y and theta, width^2 / n; the authors give none.

    A scan turned by too much moves its x histogram by that angle times the mean y of the readings that face x.
    """
    facing = _facing(angles - main)
    turned = points @ se2.rotation(main - theta)
    sizes = (facing[:, 0].sum(), facing[:, 1].sum(), len(points))
    rows = zip(peaks, widths, sizes, strict=True)
    variance = [(peak.width * bin_width) ** 2 / max(n, 1.0) for peak, bin_width, n in rows]
    carried = np.eye(3)
    carried[0, 2] = np.average(turned[:, 1], weights=facing[:, 0])
    carried[1, 2] = -np.average(turned[:, 0], weights=facing[:, 1])
    carried[:2] = se2.rotation(main) @ carried[:2]
    covariance: Cov = carried @ np.diag(variance) @ carried.T
    return 0.5 * (covariance + covariance.T)


def _facing(angles: Floats) -> Floats:
    """Return (n, 2) shares by which surfaces that run in these directions face x and y."""
    return np.stack([np.sin(angles) ** 2, np.cos(angles) ** 2], axis=1)
