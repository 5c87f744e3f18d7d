"""Warm-up: every kernel that a drive needs is compiled before the robot moves.

Machine code is kept on disk, so that this takes seconds in the first run of a version and a second in the others. A new
part of the package that has kernels adds a function to `PARTS`.
"""

from __future__ import annotations

import functools
import gc
import time
from collections.abc import Callable

import numpy as np

from curvescan._compilation import watch
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.dynamic import dynamic_readings
from curvescan.mapping.run_maps import build_maps
from curvescan.matchers import DEFAULT_METHOD, find_matcher, match
from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.assessment.confidence import weigh
from curvescan.matchers.curvescan.assessment.information import covariance
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.direction_histogram import direction_histogram
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.keypoints import find_corners, with_ends
from curvescan.matchers.curvescan.features.objects import Objects, find_objects
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.features.sampling import choose_samples
from curvescan.matchers.curvescan.features.surfels import N_COLUMNS
from curvescan.matchers.curvescan.proposal.hypotheses import most_voted, pair_keypoints
from curvescan.matchers.curvescan.proposal.rotation_hypotheses import rotation_hypotheses
from curvescan.matchers.curvescan.proposal.scoring import best_beside
from curvescan.matchers.curvescan.proposal.search import Problem, search
from curvescan.matchers.curvescan.refinement import refine_fully
from curvescan.odometry import Odometry, OdometryConfig, run_odometry
from curvescan.scan import LaserScan
from curvescan.se2 import between as between_poses
from curvescan.se2.uncertain import UncertainPose, between, compose, fuse, inverse
from curvescan.types import Floats

_N_BEAMS = 180
_BEAMS = np.arange(_N_BEAMS) * (2.0 * np.pi / _N_BEAMS)
_PERIOD_S = 0.1


def warm_up(method: str = DEFAULT_METHOD, *, slam: bool = True) -> float:
    """Compile all kernels that matching, odometry, SLAM and maps need, or load them where they have been compiled before.

    The first match of a process does the same for itself, piece by piece, when it may be least welcome: a robot that
    drives calls this before it starts its motors. Nothing is read or written but the cache of the kernels. Objects that are
    there when it ends are left out of Python's later garbage collections (:func:`gc.freeze`).

    Parameters
    ----------
    method : str
        Name of the matcher; see ``MATCHERS``.
    slam : bool
        Whether to compile those of SLAM and localization too.

    Returns
    -------
    float
        Seconds that it took.

    Raises
    ------
    InvalidArgumentError
        When the method is unknown.
    MissingPackageError
        When it needs a package that is not installed.
    """
    started = time.perf_counter()
    find_matcher(method, None)
    with watch.held():
        for part in PARTS:
            part(method)
        if slam:
            _warm_up_slam()
    # the compiler leaves a million objects: to look through them takes the collector a tenth of a second, in the middle of a drive
    gc.collect()
    gc.freeze()
    return time.perf_counter() - started


def _warm_up_matches(method: str) -> None:
    # corners, two scenes that have nothing in common, and a bare wall, which leaves a direction open
    room, wall = _scan(_room(0.0, 0.0)), _scan(_wall())
    for reference, current in ((room, room), (room, wall), (wall, wall)):
        match(reference, current, method=method)
        match(reference, current, method=method, guess=(0.1, 0.0, 0.0))


def _warm_up_drive(method: str) -> None:
    # there and back with beam times and wheels, a scan that cannot be matched among them
    xs = [0.0, 0.0, 0.02, 0.05, 0.1, 0.1, 0.05, 0.0]
    scans = [
        _scan(_wall() if k == 4 else _room(x, 0.5 * x), stamp=k * _PERIOD_S, sweep=_PERIOD_S) for k, x in enumerate(xs)
    ]
    wheels = np.array([(x, 0.5 * x, 0.0) for x in xs])
    for config in (None, OdometryConfig.scan_to_scan()):
        run = run_odometry(scans, Odometry(method, config=config), odometry_poses=wheels)
    build_maps(scans, run.trajectory.poses, run.is_joined, occupancy=OccupancyConfig())
    # nothing has moved there
    dynamic_readings(_scan(0.5 * _room(0.0, 0.0)), [(scans[0], np.zeros(3))])


def help_compile(k: int) -> None:
    """Compile what the process that is helped comes to last, each helper k something else first; see `_compilation`."""
    find_matcher(DEFAULT_METHOD, None)
    stages: list[Callable[[], None]] = [
        functools.partial(part, _no_features(), CurvescanConfig()) for part in BACKWARDS
    ]
    stages.append(_warm_up_slam)
    # one helper alone first does its share of what a match needs; the second begins with SLAM
    first = (0, len(stages) - 1, 2)[k]
    for stage in stages[first:] + stages[:first]:
        stage()
    warm_up()


def _assess(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    assess_pose(nothing, nothing, np.zeros(3), config)


def _pair_keypoints(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    image, keypoints, steps = nothing.image, nothing.keypoints, config.hypotheses
    rotation_hypotheses(nothing.directions, nothing.directions, steps.n_rotations, np.zeros(3))
    poses = pair_keypoints(keypoints, keypoints, image, image, steps.turn_tolerance, 1)
    most_voted(poses, steps.cell, 0.5 * steps.cell, steps.max_tried)


def _refine(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    sigmas = config.refinement.closer_schedule, config.refinement.full_schedule
    refine_fully(np.zeros((1, 3)), nothing.image, nothing.image, *sigmas)


def _covariance(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    find_objects(nothing.image.surfels, nothing.bounds)
    covariance(np.ones(3), np.eye(3), np.ones(3), np.zeros(3, dtype=np.bool_), 1.0)


def _weigh(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    # two poses, which are sorted
    weigh(Problem(nothing, nothing, None, config), np.zeros((2, 3)), np.zeros(2))


def _search(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    search(nothing, nothing, None, config)


def _find_keypoints(nothing: CurvescanFeatures, config: CurvescanConfig) -> None:
    surfels, rules = nothing.image.surfels, config.keypoints
    sums, most = np.zeros((1, 5)), rules.max_keypoints
    direction_histogram(surfels)
    choose_samples(surfels, config.scoring.n_samples)
    with_ends(nothing.keypoints, surfels, sums, nothing.bounds, rules.end_arm, False, most)
    sigma = config.segments.range_sigma_min
    find_corners(surfels, sums, nothing.bounds, rules.arm_lengths, sigma, rules.min_turn, most)


BACKWARDS = (_assess, _refine, _weigh, _covariance, _pair_keypoints, _search, _find_keypoints)
"""Stages of the default matcher for helpers to compile, each before the process that is helped comes to it: with one helper
that is the half that comes last, for what both compile at the same time is compiled twice. Each runs without a scan, so that
no other has to be compiled.
"""


def _no_features() -> CurvescanFeatures:
    """Return the features of a scan without readings: kernels take them, and nothing of a scan has to be compiled."""
    surfels = np.empty((0, N_COLUMNS))
    image = RangeImage(surfels, surfels, np.array([0.0, 1.0, 0.01, 1.0]), np.full(1, -2))
    return CurvescanFeatures(
        n_beams=0,
        beam_idx=np.empty(0, dtype=np.int64),
        bounds=np.zeros(1, dtype=np.int64),
        objects=Objects(*find_objects(surfels, np.zeros(1, dtype=np.int64))),
        image=image,
        wide_image=image,
        full_image=image,
        keypoints=np.empty((0, 5)),
        directions=np.zeros(120),
    )


def _warm_up_whatever_matches(_: str) -> None:
    """Call the kernels that a drive needs only where its scans match, whatever a matcher makes of the scenes above."""
    at = UncertainPose(np.zeros(3), np.eye(3))
    compose(at, at), between(at, at), inverse(at), fuse(at, at)
    nothing = _no_features()
    image, fine = nothing.image, CurvescanConfig().scoring.fine
    best_beside(np.zeros(3), np.zeros(3), np.zeros(1), image, image, *fine)


def _warm_up_slam() -> None:
    """Call the kernels of SLAM: three keyframes that stand in a triangle, and the three edges between them."""
    # SciPy's sparse matrices take their time to load
    from curvescan.slam.localization.correlative import likely_poses
    from curvescan.slam.localization.field import DistanceField
    from curvescan.slam.loops.cycles import cycle_distances
    from curvescan.slam.loops.overlap import foretold_overlap, range_profile
    from curvescan.slam.loops.place_index import signature
    from curvescan.slam.pose_graph.consistency import largest_clique
    from curvescan.slam.pose_graph.marginals import marginal_covariances
    from curvescan.slam.pose_graph.optimization import Edges, normal_equations, optimize, squared_distances
    from curvescan.slam.pose_graph.sparse import block_pattern
    from curvescan.slam.thinning import crowded_places

    ends, anchors = np.array([[0, 1], [1, 2], [0, 2]]), np.zeros(1, dtype=np.int64)
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [1.0, 1.0, 1.0]])
    covariances = np.array([np.eye(3)] * 3)
    edges = Edges.of(ends, between_poses(poses[ends[:, 0]], poses[ends[:, 1]]), covariances)
    pattern = block_pattern(len(poses), ends, 3)
    optimize(poses, edges, np.ones(3), anchors, max_iterations=1)
    squared_distances(poses, edges)
    data, _, _ = normal_equations(poses, edges, np.ones(3), anchors, pattern)
    marginal_covariances(pattern, data, anchors)
    largest_clique(np.ones((3, 3), dtype=np.bool_))
    cycle_distances(ends, poses, covariances, poses, covariances, np.ones(3), 0.5, 0.25)
    field = DistanceField(
        distance=np.zeros((1, 1), dtype=np.float32),
        is_free=np.ones((1, 1), dtype=np.bool_),
        is_solid=np.ones((1, 1), dtype=np.bool_),
        origin=np.zeros(2),
        resolution=1.0,
    )
    field.agreement(np.ones((8, 2)), np.zeros(3))
    likely_poses(field, np.zeros((1, 2)), np.ones((8, 2)), 1)
    crowded_places(poses, np.zeros(3, dtype=np.int64), 3, 1.0, 1.0, 1)
    profile = range_profile(_scan(_room(0.0, 0.0)))
    foretold_overlap(profile[np.newaxis], anchors, poses[:1], profile)
    signature(np.zeros((2, 5)))


PARTS: tuple[Callable[[str], None], ...] = (_warm_up_matches, _warm_up_drive, _warm_up_whatever_matches)
"""What is compiled, in the order of use; each takes the name of the matcher."""


def _scan(ranges: Floats, stamp: float = 0.0, sweep: float = 0.0) -> LaserScan:
    return LaserScan(
        ranges,
        angle_min=0.0,
        angle_increment=float(_BEAMS[1]),
        range_max=30.0,
        stamp=stamp,
        time_increment=sweep / _N_BEAMS,
    )


def _room(x: float, y: float) -> Floats:
    """Return what a sensor at (x, y) sees of an L-shaped room, metres: of two rectangles it stands in the farther wall."""
    rectangles = ((-2.0, 2.5, -1.5, 1.8), (-1.0, 1.2, -1.0, 4.0))
    c, s = np.cos(_BEAMS), np.sin(_BEAMS)
    with np.errstate(divide="ignore"):
        walls = [
            np.minimum(np.where(c > 0.0, x_max - x, x_min - x) / c, np.where(s > 0.0, y_max - y, y_min - y) / s)
            for x_min, x_max, y_min, y_max in rectangles
        ]
    farther: Floats = np.maximum(*walls)
    return farther


def _wall() -> Floats:
    """Return the ranges of one long wall, two metres away, metres."""
    is_seen = np.abs(_BEAMS - np.pi) < 1.0
    return np.where(is_seen, -2.0 / np.cos(_BEAMS), np.nan)
