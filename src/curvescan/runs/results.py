"""What the results of every run have in common: the trajectory, the maps along it, and the record run.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from curvescan.io.log import Log
from curvescan.io.trajectories.layouts import write_csv, write_tum
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import write_map
from curvescan.mapping.run_maps import RunMaps, build_maps
from curvescan.odometry import OdometryRun
from curvescan.odometry.deskewing import deskewed_along
from curvescan.plots.map import draw_map
from curvescan.plots.occupancy import draw_occupancy
from curvescan.types import Pose

RUN_RECORD = "run.json"


@dataclass(frozen=True, eq=False, kw_only=True)
class SavedMaps:
    """The maps of a run that was written.

    Attributes
    ----------
    title : str
        Of their pictures.
    maps : RunMaps
        The maps.
    left_out : tuple of str
        What was not written and why, a sentence each.
    """

    title: str
    maps: RunMaps
    left_out: tuple[str, ...]


def save_trajectory_and_maps(
    folder: Path,
    run: OdometryRun,
    log: Log,
    *,
    is_deskewed: bool,
    what: str = "",
    occupancy: OccupancyConfig,
    truth: Pose | None = None,
    maps: RunMaps | None = None,
    is_map_drawn: bool = True,
) -> SavedMaps:
    """Write trajectory.tum, trajectory.csv, map.png, and the occupancy map: map.pgm with map.yaml, and occupancy.png.

    truth (n, 3); maps: The maps, where they have been made already; None to read the log once more.
    """
    title = title_of(run, log, what)
    write_tum(folder / "trajectory.tum", run.trajectory)
    write_csv(folder / "trajectory.csv", run.trajectory, [o.name.lower() for o in run.outcomes])
    maps = maps or maps_of(run, log, is_deskewed=is_deskewed, occupancy=occupancy)
    if is_map_drawn:
        draw_map(folder / "map.png", run, maps, title=title, wheels=log, truth=truth)
    if maps.grid is None:
        return SavedMaps(title=title, maps=maps, left_out=(f"no occupancy map: {maps.why_no_grid}",))
    write_map(folder, maps.grid)
    draw_occupancy(folder / "occupancy.png", maps.grid, run.trajectory.poses, title=f"{title}: occupancy")
    return SavedMaps(title=title, maps=maps, left_out=())


def title_of(run: OdometryRun, log: Log, what: str) -> str:
    """Return the title of the pictures of a run: the log, the method, and what ran."""
    title = ", ".join(filter(None, (f"{log.name}: {len(run.outcomes):,} scans", run.method, what)))
    if run.is_partial:
        title += f" (partial: interrupted, {len(log):,} scans in all)"
    return title


def maps_of(
    run: OdometryRun,
    log: Log,
    *,
    is_deskewed: bool,
    cell: float | None = 0.05,
    occupancy: OccupancyConfig | None = None,
) -> RunMaps:
    """Return the maps of a run, as :func:`build_maps` does, from its scans as they were matched."""
    seen = deskewed_along(log, run.trajectory) if is_deskewed else log
    return build_maps(seen, run.trajectory.poses, run.is_joined, cell=cell, occupancy=occupancy)


def write_record(folder: Path, record: Mapping[str, object], name: str = RUN_RECORD) -> None:
    """Write the record of a run, the last of its files: what it holds, and under "files" the names of them all.

    By these names a later run into the same folder knows what to replace; see :func:`curvescan.io.output_folder`.
    """
    files = sorted({file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()} | {name})
    text = json.dumps({**record, "files": files}, indent=2)
    (folder / name).write_text(text + "\n", encoding="utf-8", newline="\n")


def list_further_files(folder: Path, results: Path) -> None:
    """Write into `folder` the record of the results that it adds files to, with the names of those."""
    record = json.loads((results / RUN_RECORD).read_text("utf-8"))
    further = [file.name for file in folder.iterdir()]
    record["files"] = sorted({*record["files"], *further})
    (folder / RUN_RECORD).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8", newline="\n")
