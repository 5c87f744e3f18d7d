"""The paper's experiments 2, 3 and 4: drives of a robot, every method on the same scans (the paper's sections 3.2 and 3.3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from curvescan import se2
from curvescan.evaluation.trajectory_errors import TrajectoryErrors, trajectory_errors
from curvescan.mapping.dynamic import dynamic_along
from curvescan.odometry import Odometry, OdometryConfig, OdometryRun, OdometryStep, run_odometry
from curvescan.paper.random_transform import SUCCESS
from curvescan.simulation import Drive, Simulation, simulate
from curvescan.types import Floats, Pose


@dataclass(frozen=True, kw_only=True)
class DriveExperiment:
    """One drive of the paper.

    Attributes
    ----------
    number : int
        The paper's number of the experiment.
    title : str
        What it is.
    n_scans : int
        Scans, as in the paper.
    n_people : int
        People walking around the robot.
    drive : Drive
        How the robot drives: so that the scans span the paper's path.
    path : {"route", "home"}
        "route", once along a building's corridors, or "home", small moves about the start and back.
    """

    number: int
    title: str
    n_scans: int
    n_people: int
    drive: Drive
    path: Literal["route", "home"]

    def simulate(self, *, seed: int = 0, share: float = 1.0) -> Simulation:
        """Return the drive, or its first `share`."""
        return simulate(
            "office-floor",  # a round room would hide the heading from every laser
            sensor="sick-lms200",
            n_scans=max(int(self.n_scans * share), 2),
            n_people=self.n_people,
            path=self.path,
            drive=self.drive,
            seed=seed,
        )


RETURN_HOME = DriveExperiment(
    number=2, title="return home", n_scans=1100, n_people=0, drive=Drive(speed=0.3), path="home"
)
STATIC = DriveExperiment(
    number=3,
    title="static comparison",
    n_scans=325,
    n_people=0,
    drive=Drive(speed=1.25, turn_rate=1.5, acceleration=2.0),
    path="route",
)
DYNAMIC = DriveExperiment(
    number=4,
    title="dynamic comparison",
    n_scans=525,
    n_people=20,
    drive=Drive(speed=0.95, turn_rate=1.5, acceleration=1.5),
    path="route",
)


@dataclass(frozen=True, kw_only=True)
class LostSteps:
    """Steps that failed or were wrong (beyond 0.1 m or 2 degrees), and what would be left without them.

    Attributes
    ----------
    n_failed, n_wrong : int
        Steps without a match, and steps matched wrongly.
    motion, turn : float
        Mean true motion of these steps, metres, and mean turn, radians; NaN without any.
    usual_motion, usual_turn : float
        The same of all other steps.
    end_without : float
        Distance of the end pose from the true one if these steps were the true ones, metres.
    """

    n_failed: int
    n_wrong: int
    motion: float
    turn: float
    usual_motion: float
    usual_turn: float
    end_without: float


@dataclass(frozen=True, kw_only=True)
class MovedScore:
    """Readings said to have moved, against those that hit people.

    Attributes
    ----------
    n_right : int
        Readings of people said to have moved.
    n_said : int
        Readings said to have moved.
    n_true : int
        Readings of people.
    """

    n_right: int
    n_said: int
    n_true: int

    @property
    def precision(self) -> float:
        """Share of what was said that is true; NaN when nothing was."""
        return self.n_right / self.n_said if self.n_said else math.nan

    @property
    def recall(self) -> float:
        """Share of what is true that was said; NaN when nothing is."""
        return self.n_right / self.n_true if self.n_true else math.nan


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenarioResult:
    """How one method did on one drive.

    Attributes
    ----------
    run : OdometryRun
        The odometry.
    errors : TrajectoryErrors
        Against the true poses.
    variances : (m, 3) float64
        Diagonal of the covariance of each match that found a pose: m^2, m^2, rad^2.
    moved : MovedScore
        How well moving readings are told under its poses.
    lost : LostSteps
        The steps at which it lost its way.
    """

    run: OdometryRun
    errors: TrajectoryErrors
    variances: Floats
    moved: MovedScore

    lost: LostSteps

    @property
    def n_failed(self) -> int:
        """Number of matches without a pose."""
        return sum(self.run.failures.values())


def run_drive(
    log: Simulation,
    methods: Sequence[str],
    *,
    on_step: Callable[[OdometryStep], None] | None = None,
) -> dict[str, ScenarioResult]:
    """Return what each method makes of the same drive, scan to scan, with its default parameters.

    Parameters
    ----------
    log : Simulation
        The drive.
    methods : sequence of str
        Names of matchers.
    on_step : callable or None
        Called after each scan of each method.
    """
    return {method: _run_one(log, method, on_step) for method in methods}


def _run_one(
    log: Simulation, method: str, on_step: Callable[[OdometryStep], None] | None
) -> ScenarioResult:
    variances: list[Floats] = []

    def collect(step: OdometryStep) -> None:
        if step.match is not None and step.match.ok:
            variances.append(np.diag(step.match.covariance))
        if on_step:
            on_step(step)

    run = run_odometry(log, Odometry(method, config=OdometryConfig.scan_to_scan()), on_step=collect)
    return ScenarioResult(
        run=run,
        errors=trajectory_errors(run.trajectory.poses, log.truth.poses),
        variances=np.array(variances).reshape(-1, 3),
        moved=score_moved(log, run),
        lost=find_lost_steps(log.truth.poses, run),
    )


def find_lost_steps(true_poses: Pose, run: OdometryRun) -> LostSteps:
    """Return where a run lost its way, and how it would have ended with those steps put right."""
    poses = run.trajectory.poses
    motions, true_motions = (se2.between(p[:-1], p[1:]) for p in (poses, true_poses))
    error = se2.between(true_motions, motions)
    is_off = (np.hypot(error[:, 0], error[:, 1]) > SUCCESS[0]) | (np.abs(error[:, 2]) > SUCCESS[1])
    is_matched = run.is_matched[1:]
    is_lost = is_off | ~is_matched
    end = se2.identity()
    for motion in np.where(is_lost[:, np.newaxis], true_motions, motions):
        end = se2.compose(end, motion)
    off = se2.between(se2.between(true_poses[0], true_poses[-1]), end)
    size = np.column_stack(
        [np.hypot(true_motions[:, 0], true_motions[:, 1]), np.abs(true_motions[:, 2])]
    )
    mean = [size[m].mean(axis=0) if m.any() else np.full(2, np.nan) for m in (is_lost, ~is_lost)]
    return LostSteps(
        n_failed=int(np.count_nonzero(~is_matched)),
        n_wrong=int(np.count_nonzero(is_off & is_matched)),
        motion=float(mean[0][0]),
        turn=float(mean[0][1]),
        usual_motion=float(mean[1][0]),
        usual_turn=float(mean[1][1]),
        end_without=float(np.hypot(off[0], off[1])),
    )


def score_moved(log: Simulation, run: OdometryRun) -> MovedScore:
    """Return how well the moving readings of a drive are told under the poses of a run."""
    found = np.array(list(dynamic_along(log, run.trajectory.poses, run.is_joined)))
    return MovedScore(
        n_right=int(np.count_nonzero(found & log.is_person)),
        n_said=int(np.count_nonzero(found)),
        n_true=int(np.count_nonzero(log.is_person)),
    )
