"""curvescan localize: where the sensor of a log is in a saved map."""

from __future__ import annotations

import sys

from curvescan.cli.options import (
    ConfigFile,
    Configs,
    LogPath,
    MapFile,
    MethodConfigs,
    MethodName,
    OutFolder,
    Preparation,
    PreparationFlags,
    Reading,
    ReadingFlags,
    SlamConfigs,
    SlamFlags,
    results_folder,
)


def localize(
    log: LogPath,
    /,
    *,
    map: MapFile,  # noqa: A002 - the flag's name
    out: OutFolder = None,
    method: MethodName = "curvescan",
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Find and follow the sensor of a log in a map, with no guess.

    Writes trajectory.tum and trajectory.csv (poses in the frame of the map with covariances, NaN while the sensor is
    searched for), map.png and run.json.
    """
    from curvescan.cli.console import load_kernels, run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import localize as localize_log

    source, out = reading.open(log), results_folder(out, log, "localize")
    with run_display(lambda: load_kernels(method, slam=True)) as display:
        result = localize_log(
            source,
            map,
            out=out,
            method=method,
            config=slam_config.slam,
            matcher=configs.of(method),
            odometry_prior=preparation.wanted,
            as_is=preparation.as_is,
            command=sys.argv,
            source=log,
            display=display,
            keeps_steps=False,
        )
    return report(result, out)
