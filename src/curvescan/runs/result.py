"""Run: what odometry, SLAM or localization makes of a log."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from curvescan.configs import counted
from curvescan.diagnostics.issues import Issue
from curvescan.diagnostics.preparation import PreparedLog
from curvescan.diagnostics.verdict import Verdict
from curvescan.engines import RunRecord
from curvescan.engines.engine import Engine
from curvescan.io.files.output import output_folder
from curvescan.io.log import Log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.mapping.run_maps import RunMaps
from curvescan.odometry import Step
from curvescan.runs.results import check_kept, maps_of_run, save_run
from curvescan.slam import Localizer, Slam, SlamMap
from curvescan.types import Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Run:
    """What :func:`curvescan.run` and :func:`curvescan.localize` return.

    Attributes
    ----------
    log : Log
        The log.
    engine : Odometry, Slam or Localizer
        What ran, in its last state.
    record : RunRecord
        The steps in columns: outcomes, failures, times, poses as reported with each scan and by odometry alone.
    verdict : Verdict
        Whether the trajectory can be trusted, and if not, why.
    scans : Log
        The log as it was run: mended, its scans held in memory where they are few.
    prepared : PreparedLog or None
        What was mended in the log, and whether its wheels or gyroscope are used; None of a running laser.
    maps : RunMaps or None
        The maps along the trajectory, where they are made already.
    occupancy : OccupancyConfig
        How to make the occupancy map.
    truth : (n, 3) float64 or None
        True poses, drawn with the map.
    command : tuple of str
        The command line behind the run.
    source : Path or None
        The file or folder that the log was read from.
    inputs : tuple of Path
        Files that saving must not replace: the source, and the map that was continued or localized in.
    details : mapping
        Further entries of run.json.
    files, left_out : tuple of str
        Names of the files written, and what was not written and why.
    """

    log: Log
    engine: Engine
    record: RunRecord
    verdict: Verdict
    scans: Log
    prepared: PreparedLog | None = None
    maps: RunMaps | None = None
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)
    truth: Pose | None = None
    command: tuple[str, ...] = ()
    source: Path | None = None
    inputs: tuple[Path, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def trajectory(self) -> Trajectory:
        """Stamp, pose and covariance at each scan. SLAM revises every pose; in a saved map unknown ones are NaN."""
        return self.record.trajectory

    @property
    def issues(self) -> tuple[Issue, ...]:
        """What is still wrong or odd with the log, as :func:`curvescan.find_issues` has it."""
        return () if self.prepared is None else self.prepared.issues

    @property
    def steps(self) -> tuple[Step, ...]:
        """What the engine returned for each scan, as it was reported at the time."""
        return self.record.steps

    @cached_property
    def map(self) -> SlamMap | OccupancyGrid | None:
        """Of odometry the occupancy, None where it would be too large; of SLAM and localization the SlamMap."""
        if isinstance(self.engine, Localizer):
            return self.engine.map
        maps = self.maps or maps_of_run(self, cell=None)
        return replace(self.engine.map, grid=maps.grid) if isinstance(self.engine, Slam) else maps.grid

    @property
    def first_fix(self) -> int | None:
        """Number of the first scan whose pose is known; None where none is."""
        known = np.flatnonzero(np.isfinite(self.trajectory.poses[:, 0]))
        return int(known[0]) if known.size else None

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the map and the trajectory, and return the axes; see :func:`curvescan.plot.map`."""
        from curvescan.plots import plot

        return plot.map(self, ax=ax)

    def save(self, folder: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write all results into a folder, as ``out=`` does, and return the names of the files.

        Raises
        ------
        OutputError
            When the results cannot be written.
        """
        if self.source is not None:
            check_kept(self.source, Path(folder))
        with output_folder(folder, inputs=self.inputs) as new:
            save_run(new, self)
            return tuple(sorted(file.name for file in new.iterdir()))

    def __repr__(self) -> str:
        n, n_failed = len(self.record.outcomes), int(np.count_nonzero(self.record.is_failed))
        names = {Slam: "SLAM", Localizer: "localization"}
        what = names.get(type(self.engine), "odometry")
        partial = ", interrupted" * self.record.is_partial
        trusted = "trusted" if self.verdict.is_trusted else "not to be trusted"
        written = f", {counted(len(self.files), 'file')} written" if self.files else ""
        scans = counted(n, "scan")
        return f"Run({self.log.name!r}: {what}, {scans}, {n_failed:,} not matched{partial}, {trusted}{written})"

    def _repr_png_(self) -> bytes | None:
        from matplotlib.figure import Figure

        if self.map is None or self.first_fix is None:
            return None
        figure, picture = Figure(figsize=(8.0, 8.0), layout="constrained"), BytesIO()
        self.plot(ax=figure.subplots())
        figure.savefig(picture, format="png", dpi=100, bbox_inches="tight")
        return picture.getvalue()

    def _repr_html_(self) -> str:
        picture = self._repr_png_()
        image = f'<img src="data:image/png;base64,{base64.b64encode(picture).decode()}">' if picture else ""
        return f"<p><b>{escape(repr(self))}</b><br>{escape(self.verdict.sentence)}</p>{image}"
