"""curvescan localize: where the sensor of a log is in a saved map."""

from __future__ import annotations

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


def localize(
    log: LogPath,
    /,
    *,
    map: MapFile,  # noqa: A002 - the flag's name
    out: OutFolder = None,
    rules: SlamRules = SlamFlags(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
) -> int:
    """Find and follow the sensor of a log in a map, with no guess.

    Writes trajectory.tum and trajectory.csv (poses in the frame of the map with covariances, NaN while the sensor is
    searched for), map.png and run.json.
    """
    from curvescan.cli.console import run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import localize as localize_log

    source, out = use.reading.open(log), results_folder(out, log, "localize")
    with run_display() as display:
        result = localize_log(
            source, map, out=out, config=rules.slam, display=display, **run_options(log, rules.matching, use)
        )
    return report(result, out)
