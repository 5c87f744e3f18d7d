"""curvescan odometry, slam and localize: a log in; a trajectory and a map out, or places in a saved map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import tyro

import curvescan
from curvescan.cli.console import ERR, OUT, run_display
from curvescan.cli.options import (
    Chain,
    LogFlags,
    LogPath,
    LogUse,
    MapConfig,
    MapFile,
    MatcherFlags,
    OdometryFlags,
    OdometryRules,
    OutFolder,
    SlamFlags,
    SlamRules,
    results_folder,
)
from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError
from curvescan.io.writing import ExportName
from curvescan.mapping.config import OccupancyConfig
from curvescan.types import UncertainPose

if TYPE_CHECKING:
    from curvescan.runs.result import Run
    from curvescan.slam import SlamMap


def odometry(
    log: LogPath,
    /,
    *,
    out: OutFolder = None,
    chain: Chain = "auto",
    export: tuple[ExportName, ...] = (),
    rules: OdometryRules = OdometryFlags(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
) -> int:
    """Follow the sensor of a log by matching its scans, and write the trajectory and the maps.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png, wheels.png (the map by the log's wheel odometry),
    run.json, and the occupancy map: map.pgm with map.yaml, as Nav2 and map_server load it, and occupancy.png. Ctrl-C
    ends the run and writes the results so far, marked as partial.

    The last line says whether the trajectory can be trusted and, if not, why. Exit status 0 when it can, 3 when it was
    written but is not to be trusted.

    Parameters
    ----------
    chain
        What a scan is matched with: `keys`, a keyframe until it is left behind; `last`, the scan before it; `auto`,
        keyframes for the default matcher and the last scan for the others.
    export
        Also write trajectory.kitti, graph.g2o or run.mcap: 3x4 rows, the matches as a pose graph, or scans and poses
        for Foxglove and ROS 2.
    """
    out, options = results_folder(out, log, "odometry"), {"exports": export, "occupancy": occupancy}
    return _run(curvescan.run, log, rules.matching, use, out=out, config=rules.config(chain), **options)


def _run(
    run: Callable[..., Run], log: Path, matching: MatcherFlags, use: LogFlags, *, out: Path, **options: Any
) -> int:
    """Run over a log, print how it went and what was written, and return the exit status."""
    from curvescan.cli.summary import report

    source = use.reading.open(log)
    options |= use.options(matching)
    before = {path.name for path in out.iterdir()} if out.is_dir() else set()
    with run_display() as display:
        result = run(source, out=out, source=log, keeps_steps=False, display=display, **options)
    if gone := sorted(before - {path.name for path in out.iterdir()}):
        ERR.print(f"removed from {out}, where the run before had written them: {', '.join(gone)}", soft_wrap=True)
    return report(result, out)


Pairs: TypeAlias = Annotated[tuple[tuple[int, int], ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="I J")]


@dataclass(frozen=True, kw_only=True)
class EditFlags:
    """Edits of the map that is continued; its keyframes are numbered as on the page of `curvescan view`."""

    drop: Pairs = ()
    """Drop the closures between keyframes I and J, numbered as on the page of `curvescan view`; may be repeated."""
    add: Pairs = ()
    """Add a closure between keyframes I and J, as the matcher finds it without a guess; may be repeated."""
    edits: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File of edits to replay on the map, as `curvescan view` saves it; --drop and --add come after them."""


def slam(
    log: LogPath | None = None,
    /,
    *,
    out: OutFolder = None,
    map: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,  # noqa: A002 - the flag's name
    edits: Annotated[EditFlags, tyro.conf.arg(name="")] = EditFlags(),
    export: tuple[ExportName, ...] = (),
    rules: SlamRules = SlamFlags(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
) -> int:
    """Close the loops of a log: odometry, and a pose graph that revises every pose.

    Writes trajectory.tum and trajectory.csv (every pose revised, with marginal covariances), trajectory_online.tum
    (poses as they were reported), map.png, wheels.png (the map by the log's wheel odometry), graph.png, graph.g2o,
    closures.csv, map.csmap, run.json, and the occupancy map: map.pgm with map.yaml, as Nav2 and map_server load it, and
    occupancy.png. Ctrl-C ends the run and writes the results so far, marked as partial.

    Parameters
    ----------
    map
        A map to continue, map.csmap of an earlier run: the log may begin anywhere in it. Without LOG the map is only
        mended.
    export
        Also write trajectory.kitti or run.mcap: 3x4 rows, or scans and poses for Foxglove and ROS 2. graph.g2o is
        written in any case.
    """
    folder = results_folder(out, log or map or Path(), "slam")
    begin = _mended(map, edits, None if log else folder) if edits != EditFlags() or log is None else map
    if log is None:
        return 0
    options = {"engine": "slam", "map": begin, "exports": export, "occupancy": occupancy}
    return _run(curvescan.run, log, rules.matching, use, out=folder, config=rules.slam, **options)


def _mended(path: Path | None, flags: EditFlags, out: Path | None) -> SlamMap:
    """Return the map with its edits, written with them into a folder, if there is one."""
    from curvescan.editing.edits import Edit, added, edited, read_edits, save_map_folder
    from curvescan.slam import load_map

    if path is None or flags == EditFlags():
        raise InvalidArgumentError("give a LOG; or --map, and what to mend in it: --drop, --add or --edits")
    begin = load_map(path)
    edits = [*(read_edits(flags.edits) if flags.edits else ()), *(Edit(do="drop", i=i, j=j) for i, j in flags.drop)]
    edits += [added(begin, i, j) for i, j in flags.add]
    mended = edited(begin, edits)
    if out is not None:
        names = save_map_folder(out, mended, edits)
        OUT.print(f"{mended!r} with {counted(len(edits), 'edit')}; wrote {out}/{', '.join(names)}")
    return mended


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
    searched for), map.png, wheels.png (the map by the log's wheel odometry) and run.json.

    Parameters
    ----------
    initial_pose
        About where the sensor is at the first scan, in the frame of the map: metres, metres, degrees; then its standard
        deviations, 0.5 m and 15 deg where they are left out. The scans decide.
    """
    out = results_folder(out, log, "localize")
    begin: Any = None
    if initial_pose is not None:
        x, y, deg, *sigmas = initial_pose
        begin = np.array([x, y, math.radians(deg)])
        if not (np.isfinite(initial_pose).all() and all(sigma > 0.0 for sigma in sigmas)):
            given = " ".join(f"{value:g}" for value in initial_pose)
            raise InvalidArgumentError(f"--initial-pose takes finite X Y DEG and deviations M DEG > 0, got {given}")
        if sigmas:
            begin = UncertainPose(begin, np.diag([sigmas[0] ** 2] * 2 + [math.radians(sigmas[1]) ** 2]))
    options = {"map": map, "initial_pose": begin}
    return _run(curvescan.localize, log, rules.matching, use, out=out, config=rules.slam, **options)
