"""curvescan slam: a log in, a globally consistent trajectory and a map out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import tyro

from curvescan.cli.options import (
    LogFlags,
    LogPath,
    LogUse,
    MapConfig,
    OutFolder,
    SlamFlags,
    SlamRules,
    results_folder,
    run_options,
)
from curvescan.errors import InvalidArgumentError
from curvescan.io.exports import ExportName
from curvescan.mapping.config import OccupancyConfig

if TYPE_CHECKING:
    from curvescan.slam import SlamMap


Pairs: TypeAlias = Annotated[tuple[tuple[int, int], ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="I J")]


@dataclass(frozen=True, kw_only=True)
class EditFlags:
    """Edits of the map that is continued."""

    drop: Pairs = ()
    """Drop the closures between keyframes I and J of the map; may be repeated."""
    add: Pairs = ()
    """Add a closure between keyframes I and J of the map, as the matcher finds it without a guess; may be repeated."""
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
        Further files: kitti (trajectory.kitti, 3x4 rows), mcap (run.mcap, scans and poses for Foxglove and ROS 2);
        graph.g2o is written in any case.
    """
    from curvescan.cli.console import run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import run

    folder = results_folder(out, log or map or Path(), "slam")
    begin = _mended(map, edits, None if log else folder) if edits != EditFlags() or log is None else map
    if log is None:
        return 0
    source = use.reading.open(log)
    with run_display() as display:
        result = run(
            source,
            "slam",
            out=folder,
            config=rules.slam,
            map=begin,
            exports=export,
            occupancy=occupancy,
            display=display,
            **run_options(log, rules.matching, use),
        )
    return report(result, folder)


def _mended(path: Path | None, flags: EditFlags, out: Path | None) -> SlamMap:
    """Return the map with its edits, written with them into a folder, if there is one."""
    from curvescan.cli.console import OUT
    from curvescan.slam import load_map
    from curvescan.slam.editing.edits import Edit, added, edited, read_edits
    from curvescan.slam.editing.saving import save_map_folder

    if path is None:
        raise InvalidArgumentError("give a LOG; or --map, and with --drop, --add or --edits what to mend in it")
    begin = load_map(path)
    edits = [*(read_edits(flags.edits) if flags.edits else ()), *(Edit(do="drop", i=i, j=j) for i, j in flags.drop)]
    edits += [added(begin, i, j) for i, j in flags.add]
    mended = edited(begin, edits)
    if out is not None:
        names = save_map_folder(out, mended, edits)
        OUT.print(f"{mended!r} with {len(edits)} edits; wrote {out}/{', '.join(names)}")
    return mended
