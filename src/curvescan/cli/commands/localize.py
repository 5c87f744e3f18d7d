"""curvescan localize: where the sensor of a log is in a saved map."""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeAlias

import tyro

from curvescan.cli.options import (
    LogFlags,
    LogPath,
    LogUse,
    MapFile,
    OutFolder,
    SlamFlags,
    SlamRules,
    results_folder,
    run_options,
)

InitialPose: TypeAlias = Annotated[
    tuple[float, float, float] | tuple[float, float, float, float, float] | None,
    tyro.conf.arg(metavar="X Y DEG [M DEG]"),
]


def localize(
    log: LogPath,
    /,
    *,
    map: MapFile,  # noqa: A002 - the flag's name
    out: OutFolder = None,
    initial_pose: InitialPose = None,
    rules: SlamRules = SlamFlags(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
) -> int:
    """Find and follow the sensor of a log in a map, with no guess.

    Writes trajectory.tum and trajectory.csv (poses in the frame of the map with covariances, NaN while the sensor is
    searched for), map.png and run.json.

    Parameters
    ----------
    initial_pose
        About where the sensor is at the first scan, in the frame of the map: metres, metres, degrees; then its standard
        deviations, 0.5 m and 15 deg where they are left out. The scans decide.
    """
    import numpy as np

    from curvescan.cli.console import run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import localize as localize_log
    from curvescan.types import UncertainPose

    source, out = use.reading.open(log), results_folder(out, log, "localize")
    begin: Any = None
    if initial_pose is not None:
        x, y, deg, *sigmas = initial_pose
        here = np.array([x, y, math.radians(deg)])
        begin = (
            here if not sigmas else UncertainPose(here, np.diag([sigmas[0] ** 2] * 2 + [math.radians(sigmas[1]) ** 2]))
        )
    options = run_options(log, rules.matching, use)
    with run_display() as display:
        result = localize_log(source, map, out=out, config=rules.slam, initial_pose=begin, display=display, **options)
    return report(result, out)
