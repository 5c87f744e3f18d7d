"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path

from curvescan.cfsma.config import CfSmaConfig
from curvescan.cli.options import LogPath, Method
from curvescan.consensus.config import ConsensusConfig


def odometry(
    log: LogPath,
    /,
    *,
    out: Path,
    method: Method = "curvescan",
    range_max: float | None = None,
    curvescan: ConsensusConfig = ConsensusConfig(),  # noqa: B008 - frozen
    cfsma: CfSmaConfig = CfSmaConfig(),  # noqa: B008 - frozen
) -> int:
    """Match each scan of a log with the one before, and write the trajectory and the map.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png and run.json. Ctrl-C ends the run and writes
    what there is so far, marked as partial.

    Parameters
    ----------
    log
        The log: CARMEN, plain or gzip-compressed.
    out
        Folder for the results; made if it is missing.
    method
        The matcher.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    curvescan
        Parameters of the method "curvescan".
    cfsma
        Parameters of the method "cfsma".
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import summarise
    from curvescan.io import output_folder, read_log
    from curvescan.odometry import Odometry, run_odometry
    from curvescan.view.run import save_run

    source = read_log(log, range_max=range_max)
    chain = Odometry(method, matcher_config={"curvescan": curvescan, "cfsma": cfsma}[method])
    with output_folder(out) as folder:
        load_kernels(method)
        with progress_bar("odometry", len(source)) as advance:
            run = run_odometry(source, chain, on_step=advance)
        with ERR.status("drawing the map"):
            save_run(folder, run, source, odometry=chain, command=sys.argv, source=log)
    OUT.print(summarise(run, len(source)))
    OUT.print(f"wrote {out}/trajectory.tum, trajectory.csv, map.png, run.json")
    return 0
