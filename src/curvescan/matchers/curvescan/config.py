"""The parameters of the matcher "curvescan": lengths and angles of the places that robots work in, none of one log.

Each class configures one stage. The range noise is not among them: it is estimated from each scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from curvescan.errors import require
from curvescan.types import Floats


@dataclass(frozen=True, kw_only=True)
class SegmentsConfig:
    """Surfaces: where they break, and the line through each reading."""

    incidence_limit: float = math.radians(10.0)
    """Worst incidence angle at which two neighbouring readings are still one surface, radians in (0, pi/2)."""
    max_gap: int = 2
    """A run of at most this many missing readings does not end a surface by itself."""
    arm: float = 0.12
    """Readings within this distance decide the line through a reading, metres; two a side at least."""
    jump: float = 0.03
    """Besides what the incidence explains, neighbouring readings of one surface may lie apart by this, metres."""
    noisy: float = 0.02
    """Range noise, metres, from which on segments and lines are found anew with it."""
    jump_growth: float = 8.0
    """Growth of `jump` for each metre of range noise above `noisy`."""
    arm_growth: float = 0.9
    """Power of the range noise over `noisy` with which `arm` grows: from two thirds on the directions of lines are
    known as well as with less noise."""
    range_sigma_min: float = 0.003
    """Least range noise that a scan is taken to have, metres."""

    def __post_init__(self) -> None:
        require(
            0.0 < self.incidence_limit < math.pi / 2, "incidence_limit must lie in (0, pi/2) rad", self.incidence_limit
        )
        require(self.max_gap >= 0, "max_gap must be >= 0 readings", self.max_gap)
        require(self.arm > 0.0, "arm must be > 0 m", self.arm)
        require(self.jump > 0.0, "jump must be > 0 m", self.jump)
        require(self.noisy > 0.0, "noisy must be > 0 m", self.noisy)
        require(self.jump_growth >= 0.0, "jump_growth must be >= 0", self.jump_growth)
        require(self.arm_growth >= 0.0, "arm_growth must be >= 0", self.arm_growth)
        require(self.range_sigma_min > 0.0, "range_sigma_min must be > 0 m", self.range_sigma_min)


@dataclass(frozen=True, kw_only=True)
class KeypointsConfig:
    """Frames: corners and ends of surfaces."""

    arms: tuple[float, ...] = (0.12, 0.25, 0.5)
    """Lengths over which a surface is taken to turn, metres, ascending: furniture, door frames, walls."""
    min_turn: float = 0.4
    """Least turn of a corner, radians."""
    end_arm: float = 0.25
    """Length over which the direction of a surface is taken at its end, metres."""
    max_keypoints: int = 96
    """Corners and ends kept of a scan, at most."""

    @cached_property
    def arm_lengths(self) -> Floats:
        """`arms` as an array."""
        return np.array(self.arms, dtype=np.float64)

    def __post_init__(self) -> None:
        require(len(self.arms) > 0 and min(self.arms) > 0.0, "arms must be lengths > 0 m", self.arms)
        require(0.0 < self.min_turn < math.pi, "min_turn must lie in (0, pi) rad", self.min_turn)
        require(self.end_arm > 0.0, "end_arm must be > 0 m", self.end_arm)
        require(self.max_keypoints >= 1, "max_keypoints must be at least 1", self.max_keypoints)


@dataclass(frozen=True, kw_only=True)
class HypothesesConfig:
    """Hypotheses: which poses are tried."""

    turn_tolerance: float = 0.4
    """Two corners may be the same one if their turns differ by no more, radians."""
    max_pairs: int = 4000
    """Pairs of keypoints taken, at most."""
    cell: float = 0.3
    """Poses in a cell of this width vote for each other, metres; half as many radians wide."""
    max_tried: int = 96
    """Most voted poses that are tried."""
    n_rotations: int = 4
    """Rotations taken from the directions of all surfaces."""
    alignment_reach: float = 2.0
    """Where no pose finds support, places up to this far along each axis are tried at which walls coincide, metres."""
    alignment_bin: float = 0.1
    """Walls coincide within this width, metres."""
    n_alignments: int = 3
    """Places tried along each axis."""
    along_step: float = 0.15
    """Along corridors places this far apart are tried, metres."""
    along_reach: float = 1.8
    """How far along a corridor places are tried, metres each way."""

    def __post_init__(self) -> None:
        for name in ("turn_tolerance", "cell", "alignment_reach", "alignment_bin", "along_step", "along_reach"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))
        for name in ("max_pairs", "max_tried", "n_rotations", "n_alignments"):
            require(getattr(self, name) >= 1, f"{name} must be at least 1", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class ScoringConfig:
    """Verification: what counts as agreement, and how much of it is enough."""

    n_samples: int = 36
    """Readings of each scan that stand for all of them."""
    rough: tuple[float, float] = (0.08, 0.03)
    """Tolerance of a pose not yet refined: metres, and metres more for each metre of range."""
    moved_along: tuple[float, float] = (0.06, 0.01)
    """Tolerance of a pose along a corridor."""
    close: tuple[float, float] = (0.04, 0.005)
    """Tolerance of a pose after a quick refinement."""
    fine: tuple[float, float] = (0.03, 0.004)
    """Tolerance of a pose to be judged."""
    margin: float = 0.01
    """Metres that two readings of one surface may lie apart besides three standard deviations of their noise."""
    dynamic_min_m: float = 0.01
    """A surface moved when its readings lie to one side by more than this on the mean, metres: under it stand the
    errors that all readings of a wall share (rounding to centimetres, angle of incidence)."""
    dynamic_sigmas: float = 4.0
    """A surface moved when its readings lie to one side by more standard deviations of their mean than this."""
    n_kept: int = 4
    """Poses that are refined."""
    n_wide: int = 192
    """Readings of each scan where poses that are nearly as good as each other are compared."""
    contested: float = 0.3
    """Poses with this share of the best one's score are judged beside it."""
    n_top: int = 5
    """Poses that are judged beside one another, at most."""
    doubtful_score: float = 0.35
    """Below this score other ways to a pose are tried, too."""
    few_tried: int = 24
    """With fewer poses than this to try, other ways are tried up to the next score."""
    certain_score: float = 0.55
    """See `few_tried`."""
    guess_score: float = 0.5
    """From this score on a guess that fixes both axes is taken without a look at others."""
    min_score: float = 0.02
    """Least score of a pose that is looked at any further."""
    min_confidence: float = 0.55
    """Least confidence of a match."""
    min_inliers: int = 15
    """Least readings of the current scan that agree at a match, or a third of all where those are few."""
    ambiguity: tuple[float, float] = (0.93, 0.04)
    """Another pose with this share of the score, or less below it than this, is as good."""

    def __post_init__(self) -> None:
        require(self.n_samples >= 6, "n_samples must be at least 6", self.n_samples)
        require(self.n_wide >= 6, "n_wide must be at least 6", self.n_wide)
        require(self.min_inliers >= 1, "min_inliers must be at least 1", self.min_inliers)
        require(self.n_kept >= 1, "n_kept must be at least 1", self.n_kept)
        require(self.n_top >= 1, "n_top must be at least 1", self.n_top)
        for name in ("rough", "moved_along", "close", "fine"):
            tolerance = getattr(self, name)
            require(
                tolerance[0] > 0.0 and tolerance[1] >= 0.0, f"{name} must be metres > 0 and a slope >= 0", tolerance
            )
        for name in ("doubtful_score", "guess_score", "certain_score", "min_score", "contested", "min_confidence"):
            require(-1.0 <= getattr(self, name) <= 1.0, f"{name} must lie in [-1, 1]", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class RefinementConfig:
    """Refinement: how wrong a pose may be at each iteration."""

    quick: tuple[float, ...] = (0.06, 0.02)
    """Sigma schedule: standard deviation added in each iteration on the samples, metres, for the few best poses."""
    closer: tuple[float, ...] = (0.01,)
    """The same for the one or two that are left."""
    full: tuple[float, ...] = (0.0,)
    """The same on all readings."""

    @cached_property
    def quick_schedule(self) -> Floats:
        """`quick` as an array."""
        return np.array(self.quick, dtype=np.float64)

    @cached_property
    def closer_schedule(self) -> Floats:
        """`closer` as an array."""
        return np.array(self.closer, dtype=np.float64)

    @cached_property
    def full_schedule(self) -> Floats:
        """`full` as an array."""
        return np.array(self.full, dtype=np.float64)

    def __post_init__(self) -> None:
        for name in ("quick", "closer", "full"):
            sigmas = getattr(self, name)
            require(
                len(sigmas) > 0 and all(s >= 0.0 for s in sigmas),
                f"{name} must be lengths >= 0 m, at least one",
                sigmas,
            )


@dataclass(frozen=True, kw_only=True)
class InformationConfig:
    """Covariance: when a direction counts as open, and how wide it then is."""

    max_sigma: float = 0.1
    """A direction known no better than this is open, metres at the typical reading."""
    degenerate_sigma: float = 1.0
    """Standard deviation given to an open direction, metres at the typical reading."""
    degenerate_ratio: float = 0.1
    """A direction of which less than this share of the next one's information is known is searched along, and tested
    whether the scans agree as well some way along it."""
    fine_along_step: float = 0.05
    """The best place along it is looked for in steps of this length, metres at the typical reading."""
    max_along_turn: float = 0.5
    """Turns along it are tried up to this angle, radians."""
    offsets: tuple[float, ...] = (0.1, 0.2, 0.4)
    """How far, metres at the typical reading."""
    flat_score: float = 0.92
    """It is open when the scans agree there by this share of their score."""
    tie: float = 0.97
    """Of poses along an open direction with this share of the best score the one nearest to the guess is taken."""
    tie_ratio: float = 0.2
    """Where a direction has less than this share of the next one's information, other poses along it are no rivals: the
    covariance holds them, and the direction is named."""
    along_tolerance: float = 0.15
    """Two poses differ by a motion along a degenerate direction when nothing else of their difference exceeds
    this, metres and radians."""

    def __post_init__(self) -> None:
        for name in (
            "max_sigma",
            "degenerate_sigma",
            "degenerate_ratio",
            "fine_along_step",
            "flat_score",
            "tie_ratio",
            "along_tolerance",
        ):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class CurvescanConfig:
    """All parameters of the matcher, grouped by stage."""

    segments: SegmentsConfig = field(default_factory=SegmentsConfig)
    """Surfaces and lines."""
    keypoints: KeypointsConfig = field(default_factory=KeypointsConfig)
    """Corners and ends."""
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    """Poses to try."""
    scoring: ScoringConfig = field(default_factory=ScoringConfig)
    """Agreement of the scans."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Least squares."""
    information: InformationConfig = field(default_factory=InformationConfig)
    """Covariance."""
