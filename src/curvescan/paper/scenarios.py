"""The paper's experiments 2, 3 and 4: runs of a robot, every method on the same scans (its sections 3.2 and 3.3).

Under the paper's conditions: the noise of a real LMS200, turns of at most 4 degrees from a scan to the next (section
2.3), few people; and under hard ones: twice the noise, turns of up to 17 degrees, a crowd. All methods get the
covariance of Lu and Milios (eqs. 13-18), which needs pairs: each matched reading is paired with the nearest matched
one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.engines import RunRecord, run_engine
from curvescan.evaluation.trajectory_errors import TrajectoryErrors, trajectory_errors
from curvescan.mapping.dynamic import dynamic_along
from curvescan.matchers.baselines.iteration import IterationTrace
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.registry import MatcherConfig
from curvescan.matchers.result import Label, MatchResult
from curvescan.odometry import Odometry, OdometryConfig, Step
from curvescan.paper.random_transform import is_success
from curvescan.scan import LaserScan
from curvescan.simulation import Drive, Simulation, simulate
from curvescan.types import Bools, Cov, Floats, Pose


def lu_milios_covariance(reference: LaserScan, current: LaserScan, result: MatchResult) -> Cov:
    """Return (3, 3) the covariance of eq. 16 of a match's pose, from the readings it matched."""
    cur = current.points[result.labels_current == Label.MATCHED]
    ref = reference.points[result.labels_reference == Label.MATCHED]
    placed = se2.transform(result.pose, cur)
    squared = np.subtract.outer(placed[:, 0], ref[:, 0]) ** 2
    squared += np.subtract.outer(placed[:, 1], ref[:, 1]) ** 2
    return pose_covariance(cur, result.pose, float(squared.min(axis=1).sum()))


Condition: TypeAlias = Literal["paper", "hard"]  # under which conditions an experiment is done


class DriveExperiment(NamedTuple):
    """One drive of the paper."""

    number: int  # the paper's number of the experiment
    title: str  # what it is
    n_scans: int  # scans, as in the paper
    condition: Condition  # under which conditions
    drive: Drive  # how the robot drives
    n_people: int  # people walking around the robot

    @property
    def name(self) -> str:
        """For files and records: "3" under the paper's conditions, "3_hard" under the others."""
        return f"{self.number}" + ("_hard" if self.condition == "hard" else "")

    def simulate(self, *, seed: int = 0, share: float = 1.0) -> Simulation:
        """Return the drive, or its first `share`."""
        return simulate(
            "office-floor",  # a round room would hide the heading from every laser
            sensor="sick-lms200" if self.condition == "hard" else "sick-lms200-5mm",
            n_scans=max(int(self.n_scans * share), 2),
            n_people=self.n_people,
            drive=self.drive,
            seed=seed,
        )


_GENTLE = math.radians(4.0) / 0.2  # rad/s: 4 degrees from a scan to the next

DRIVES = (
    DriveExperiment(2, "return home", 1100, "paper", Drive(path="home", speed=0.3, turn_rate=_GENTLE), 0),
    DriveExperiment(2, "return home", 1100, "hard", Drive(path="home", speed=0.3), 0),
    DriveExperiment(3, "static comparison", 325, "paper", Drive(speed=1.25, turn_rate=_GENTLE, acceleration=2.0), 0),
    DriveExperiment(3, "static comparison", 325, "hard", Drive(speed=1.25, turn_rate=1.5, acceleration=2.0), 0),
    DriveExperiment(4, "dynamic comparison", 525, "paper", Drive(speed=1.1, turn_rate=_GENTLE, acceleration=1.5), 3),
    DriveExperiment(4, "dynamic comparison", 525, "hard", Drive(speed=0.95, turn_rate=1.5, acceleration=1.5), 20),
)
"""Experiments 2 to 4, each under the paper's conditions and under hard ones, with the paper's numbers of scans."""


@dataclass(frozen=True, kw_only=True)
class LostSteps:
    """Steps that failed or were wrong (beyond 0.1 m or 2 degrees), and what would be left without them."""

    # steps without a match, and steps matched wrongly
    n_failed: int
    n_wrong: int
    # mean true motion of these steps, metres, and mean turn, radians; NaN without any
    motion: float
    turn: float
    # the same of all other steps
    usual_motion: float
    usual_turn: float
    end_without: float  # distance of the end pose from the true one if these steps were the true ones, metres


class Share(NamedTuple):
    """How many readings of a whole are of a part."""

    n_part: int
    n_whole: int

    @property
    def value(self) -> float:
        """The share, 0 to 1; NaN where there is no whole."""
        return self.n_part / self.n_whole if self.n_whole else math.nan

    @classmethod
    def of(cls, part: Bools, whole: Bools) -> "Share":
        """Return the share of `whole`, (n_scans, n_beams), that is also `part`."""
        return cls(int(np.count_nonzero(part & whole)), int(np.count_nonzero(whole)))


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenarioResult:
    """How one method did on one run of the robot."""

    run: RunRecord  # the odometry
    errors: TrajectoryErrors  # against the true poses
    variances: Floats  # (m, 3): diagonal of the covariance of each match that found a pose: m^2, m^2, rad^2
    lu_milios: Floats  # (m, 3): the same by eq. 16 for every method, as the paper's tables have it
    # readings found to have moved, by free-space violation under its poses: those that are people, of all found; and
    # those found, of all people
    moved_precision: Share
    moved_recall: Share
    # matched readings of people and of all others, of those that the matcher matched or left unmatched
    people_matched: Share
    static_matched: Share
    lost: LostSteps  # the steps at which it lost its way
    # error of the end pose, metres, were the poses taken that a method had but refused (not converged, not
    # constrained), as programs without such checks do
    end_unrefused: float
    is_discarded: Bools  # (n_scans, n_beams): readings that the matcher left unmatched; False where the match failed

    @property
    def n_failed(self) -> int:
        """Number of matches without a pose."""
        return sum(self.run.failures.values())

    @property
    def right_share(self) -> float:
        """Share of the steps within 0.1 m and 2 degrees of the truth, 0 to 1."""
        n_steps = len(self.run.outcomes) - 1
        return 1.0 - (self.lost.n_failed + self.lost.n_wrong) / n_steps


def run_scenario(
    log: Simulation,
    method: str,
    config: MatcherConfig | None = None,
    on_step: Callable[[Step], object] = lambda _: None,
) -> ScenarioResult:
    """Return what a method makes of scans, scan to scan."""
    variances: list[Floats] = []
    lu_milios: list[Floats] = []
    motions = np.zeros((len(log), 3))
    is_matched, is_discarded = np.zeros((2, *log.ranges.shape), dtype=np.bool_)

    def collect(step: Step) -> None:
        result, k = step.match, step.index
        if result is not None:  # its pose, the one that it had and refused, or else the last motion once more
            refused = result.trace.pose if isinstance(result.trace, IterationTrace) else motions[k - 1]
            motions[k] = result.pose if result.ok else refused
        if result is not None and result.ok:
            variances.append(np.diag(result.covariance))
            lu_milios.append(np.diag(lu_milios_covariance(log[k - 1], log[k], result)))
            is_matched[k] = result.labels_current == Label.MATCHED
            is_discarded[k] = log[k].valid & ~is_matched[k]
        on_step(step)

    run = run_engine(log, Odometry(method, matcher=config, config=OdometryConfig.scan_to_scan()), on_step=collect)
    is_moved = np.zeros_like(is_matched)
    if log.is_person.any():
        is_moved = np.array(list(dynamic_along(log, run.trajectory.poses, run.is_joined)))
    is_known = is_matched | is_discarded
    return ScenarioResult(
        run=run,
        errors=trajectory_errors(run.trajectory.poses, log.truth.poses),
        variances=np.array(variances).reshape(-1, 3),
        lu_milios=np.array(lu_milios).reshape(-1, 3),
        moved_precision=Share.of(log.is_person, is_moved),
        moved_recall=Share.of(is_moved, log.is_person),
        people_matched=Share.of(is_matched, is_known & log.is_person),
        static_matched=Share.of(is_matched, is_known & ~log.is_person),
        lost=find_lost_steps(log.truth.poses, run),
        end_unrefused=_end_error(log.truth.poses, motions[1:]),
        is_discarded=is_discarded,
    )


def _end_error(true_poses: Pose, motions: Pose) -> float:
    """Return how far the end pose of so many motions lies from the true one, metres."""
    end = se2.identity()
    for motion in motions:
        end = se2.compose(end, motion)
    off = se2.between(se2.between(true_poses[0], true_poses[-1]), end)
    return float(np.hypot(off[0], off[1]))


def find_lost_steps(true_poses: Pose, run: RunRecord) -> LostSteps:
    """Return where a run lost its way, and how it would have ended with those steps put right."""
    poses = run.trajectory.poses
    motions, true_motions = (se2.between(p[:-1], p[1:]) for p in (poses, true_poses))
    is_off = ~is_success(se2.between(true_motions, motions))
    is_matched = run.is_matched[1:]
    is_lost = is_off | ~is_matched
    size = np.column_stack([np.hypot(true_motions[:, 0], true_motions[:, 1]), np.abs(true_motions[:, 2])])
    (motion, turn), (usual_motion, usual_turn) = (
        size[m].mean(axis=0).tolist() if m.any() else (math.nan, math.nan) for m in (is_lost, ~is_lost)
    )
    return LostSteps(
        n_failed=int(np.count_nonzero(~is_matched)),
        n_wrong=int(np.count_nonzero(is_off & is_matched)),
        motion=motion,
        turn=turn,
        usual_motion=usual_motion,
        usual_turn=usual_turn,
        end_without=_end_error(true_poses, np.where(is_lost[:, np.newaxis], true_motions, motions)),
    )
