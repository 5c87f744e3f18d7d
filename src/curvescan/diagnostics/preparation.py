"""prepare_log: a log as every run takes it, mended, with the motion prior that agrees with its scans."""

from __future__ import annotations

from dataclasses import dataclass

from curvescan.diagnostics.issues import Issue
from curvescan.diagnostics.mending import Mended, mend
from curvescan.diagnostics.prior.choice import Prior, choose_prior
from curvescan.diagnostics.sensor import SensorJudgement
from curvescan.io.log import Log
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class PreparedLog:
    """A log as a run takes it."""

    mended: Mended  # the log without what is wrong with it beyond doubt, what that was, and what is still wrong
    prior: Prior  # the motion by wheels or gyroscope, and why it is used or left out

    @property
    def log(self) -> Log:
        """The log to run."""
        return self.mended.log

    @property
    def odometry_poses(self) -> Pose | None:
        """(n, 3) pose at each scan by wheels or gyroscope, for ``add(scan, odometry_pose)``; None if unused."""
        return self.prior.poses

    @property
    def issues(self) -> tuple[Issue, ...]:
        """What is still wrong or odd with the log."""
        return self.mended.issues

    @property
    def sensor(self) -> SensorJudgement:
        """What the scans say of the sensor."""
        return SensorJudgement(beam_order=self.mended.report.beam_order, rotation=self.mended.report.sense)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended, whether wheels or gyroscope are used, and why: a sentence each."""
        return (*self.mended.remarks, *((self.prior.sentence,) if self.prior.sentence else ()))

    def as_plain(self) -> dict[str, object]:
        """Return what run.json holds of it."""
        done = [{"kind": i.kind, "what": i.mending, "argument": i.argument or None} for i in self.mended.done]
        return {"mended": done, "motion_prior": self.prior.sentence}


def prepare_log(
    log: Log, *, odometry_prior: bool | None = None, as_is: bool = False, is_order_needed: bool = True
) -> PreparedLog:
    """Return a log as a run takes it: what every run, command and live replay begins with.

    Parameters
    ----------
    log : Log
        Any log; a HeldLog is read once.
    odometry_prior : bool or None
        Whether to use its wheels or gyroscope: None where they agree with the scans, True in any case, False never.
    as_is : bool
        Whether to leave it as it is, and only say what is wrong.
    is_order_needed : bool
        Whether to find out in which order the beams were swept, by which sweeps are deskewed.

    Raises
    ------
    InvalidArgumentError
        When `odometry_prior` is True and the log has none, one that turns against the scans, or the output of a SLAM.
    """
    mended = mend(log, as_is=as_is, is_order_needed=is_order_needed)
    report = mended.report
    lag = report.odometry.lag if report.odometry else 0.0
    prior = choose_prior(mended.log, sense=report.sense, lag=lag, wanted=odometry_prior)
    return PreparedLog(mended=mended, prior=prior)
