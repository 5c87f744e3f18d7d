"""curvescan localize: where the sensor of a log is in a saved map."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from curvescan.cli.options import (
    ConfigFile,
    Laser,
    LogPath,
    Preparation,
    PreparationFlags,
    SensorFlags,
    SlamConfigs,
    SlamFlags,
    Topic,
    open_log,
)


def localize(
    log: LogPath,
    /,
    *,
    map: Annotated[Path, tyro.conf.arg(metavar="FILE")],  # noqa: A002 - the flag's name
    out: Path,
    range_max: float | None = None,
    topic: Topic = None,
    laser: SensorFlags = Laser(),  # noqa: B008 - frozen
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Find and follow the sensor of a log in a map, with no guess.

    Writes trajectory.tum and trajectory.csv (poses in the frame of the map with covariances, NaN while the sensor is searched for),
    map.png and run.json.

    Parameters
    ----------
    log
        The log; see `curvescan slam`.
    map
        The map, as `curvescan slam` wrote it: map.csmap.
    out
        Folder for the results; made if it is missing.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    laser
        How the laser is set up, where its log does not say so or is wrong.
    preparation
        What of the log is used, and what is mended in it.
    config
        TOML file of parameters. Flags change what it says.
    slam_config
        Parameters of SLAM that localization shares.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar, table
    from curvescan.cli.flags import with_flags
    from curvescan.diagnostics.preparation import prepare_log
    from curvescan.io import output_folder
    from curvescan.io.held import HeldLog
    from curvescan.runs.localize import run_localizer, save_localizer_run
    from curvescan.slam import Localizer, LocalizerOutcome, load_map

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    slam_map = load_map(map)
    with output_folder(out, inputs=(log, map)) as folder:
        load_kernels("curvescan", slam=True)
        given = slam_config.slam
        prepared = prepare_log(HeldLog(source), odometry_prior=preparation.wanted, as_is=preparation.as_is)
        for remark in prepared.remarks:
            ERR.print(with_flags(remark), markup=False, soft_wrap=True)
        deskew = given.odometry.deskew and prepared.sensor.can_deskew
        rules = replace(given, odometry=replace(given.odometry, deskew=deskew))
        localizer = Localizer(slam_map, config=rules)
        with progress_bar("localization", len(source)) as advance:
            run = run_localizer(
                prepared.log, localizer, odometry_poses=prepared.odometry_poses, on_step=lambda _: advance()
            )
        save_localizer_run(folder, run, name=source.name, command=tuple(sys.argv), further=prepared.as_plain())
    result = table(f"{len(run.outcomes):,} scans in {slam_map!r}", "", "count", "share")
    for outcome in LocalizerOutcome:
        n = run.outcomes.count(outcome)
        share = 100.0 * n / max(len(run.outcomes), 1)
        result.add_row(outcome.value, f"{n:,}", f"{share:.1f} %")
    OUT.print(result)
    if run.first_fix is None:
        OUT.print("the sensor was not found in the map")
    else:
        OUT.print(f"first found at scan {run.first_fix:,}")
    OUT.print(f"wrote {out}/trajectory.tum, trajectory.csv, map.png, run.json", markup=False)
    return 0 if run.first_fix is not None else 3
