"""curvescan map, view and evaluate: saved maps changed, finished runs on a page in the browser, and measured."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import tyro

import curvescan
from curvescan.cli.console import ERR, OUT, free_port, open_browser, show, wait, with_flags
from curvescan.cli.options import BenchmarkName, Flag, LaserPose, OutFolder, in_radians, results_folder
from curvescan.errors import InvalidArgumentError, OutputError, require
from curvescan.io.writing import ExportName, RunData, write_exports, write_pcd, write_ply

if TYPE_CHECKING:
    from curvescan.editing.operations import Change
    from curvescan.mapping.occupancy import OccupancyGrid
    from curvescan.slam import SlamMap

    AnyMap: TypeAlias = SlamMap | OccupancyGrid

Box: TypeAlias = tuple[float, float, float, float]
OtherMap: TypeAlias = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_BOX = tyro.conf.arg(metavar="X0 Y0 X1 Y1")


@dataclass(frozen=True, kw_only=True)
class ChangeFlags:
    """Changes of a map, in the order in which they are made."""

    merge: OtherMap = None
    """Join another map to the map, by matches without a guess; refused where too few of them agree."""
    turn: float = 0.0
    """Turn the map about the origin, degrees, counter-clockwise."""
    level: Flag = False
    """Turn the map so that most of its walls run along the axes."""
    crop: Annotated[Box | None, _BOX] = None
    """Keep only the part of the map within a box, metres."""
    rub_out: Annotated[tuple[Box, ...], tyro.conf.UseAppendAction, _BOX] = ()
    """Remove the readings that end within a box, metres; may be repeated."""
    resolution: float | None = None
    """Side of a cell of the occupancy map, metres."""

    def changed(self, given: AnyMap) -> AnyMap:
        """Return a map with the changes."""
        from curvescan.editing import operations
        from curvescan.mapping import grid_editing
        from curvescan.slam.localization.grid_map import opened

        if self.merge is not None:
            given = _merged(given, opened(self.merge))
        require(math.isfinite(self.turn), "--turn must be finite degrees", self.turn)
        editing: Any = operations if isinstance(given, curvescan.SlamMap) else grid_editing
        if self.turn:
            given = editing.turned(given, math.radians(self.turn))
        if self.level:
            given = editing.leveled(given)
        if self.crop is not None:
            given = editing.cropped(given, self.crop)
        for box in self.rub_out:
            given = editing.rubbed_out(given, box)
        return given if self.resolution is None else editing.resampled(given, self.resolution)


def edit_map(
    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")],
    /,
    *,
    out: OutFolder = None,
    changes: Annotated[ChangeFlags, tyro.conf.arg(name="")] = ChangeFlags(),
    compare: OtherMap = None,
    points: tuple[Literal["ply", "pcd"], ...] = (),
    export: tuple[ExportName, ...] = (),
) -> int:
    """Change a saved map, compare it with another, or write it in other formats.

    Makes the changes in the order of the flags below. Writes map.csmap, graph.g2o and map.pgm with map.yaml; of a plain
    map, which has no keyframes, map.pgm with map.yaml alone.

    Parameters
    ----------
    file
        The map: map.csmap of `curvescan slam`, or map.yaml. Where one of two maps is plain, both are taken as such.
    compare
        Compare the map with this later one; changes.csv and changes.png show what appeared and what is gone. Matches
        without a guess align the two; where nothing joins them, they are compared as they lie.
    points
        Write points.ply or points.pcd: all readings, or the occupied cells of a plain map.
    export
        Also write the keyframes as trajectory.kitti, graph.g2o or run.mcap.
    """
    from curvescan.editing import operations
    from curvescan.editing.edits import keyframe_trajectory, map_folder
    from curvescan.slam.localization.grid_map import opened

    out = results_folder(out, file, "map")
    inputs = [path for path in (file, changes.merge, compare) if path is not None]
    _check_place(out, inputs)
    edited = changes.changed(opened(file))
    if export and not isinstance(edited, curvescan.SlamMap):
        raise InvalidArgumentError(
            f"--export writes keyframes, and {edited!r} has none, got --export {' '.join(export)}: give the map.csmap "
            "of `curvescan slam`, or --points for the occupied cells"
        )
    found = None if compare is None else _compared(edited, opened(compare))
    with map_folder(out, edited, inputs=inputs) as folder:
        for name in points:
            write = {"ply": write_ply, "pcd": write_pcd}[name]
            seen = operations.map_points(edited) if isinstance(edited, curvescan.SlamMap) else edited.occupied_centres
            write(folder / f"points.{name}", seen)
        if export and isinstance(edited, curvescan.SlamMap):
            trajectory = keyframe_trajectory(edited)
            write_exports(folder, export, RunData(trajectory=trajectory, edges=tuple(edited.edges), scans=edited.scans))
        if found is not None:
            _write_changes(folder, _grid_of(edited), found)
        names = sorted(path.name for path in folder.iterdir())
    OUT.print(f"{edited!r}; wrote {out}/{', '.join(names)}")
    for change in found or ():
        x0, y0, x1, y1 = change.box
        OUT.print(f"{change.kind}: {x1 - x0:.2f} m by {y1 - y0:.2f} m at {x0:.2f} {y0:.2f}")
    return 0


def _check_place(out: Path, inputs: Sequence[Path]) -> None:
    """Raise OutputError where a map would replace results of a run, or a map that it is made of."""
    from curvescan.mapping.map_server import picture_of
    from curvescan.runs.results import check_kept

    if (out / "trajectory.csv").exists():
        raise OutputError(
            f"{out} holds a run, whose other results would not fit the map any more: choose another folder"
        )
    for path in inputs:
        check_kept(path, out)
        if path.suffix.lower() in (".yaml", ".yml"):
            check_kept(picture_of(path), out)


def _grid_of(given: AnyMap) -> OccupancyGrid:
    return given.occupancy() if isinstance(given, curvescan.SlamMap) else given


def _merged(one: AnyMap, other: AnyMap) -> AnyMap:
    """Return two maps joined by matches without a guess: keyframes, or cells where one of them has no keyframes."""
    from curvescan.editing.merging import laid_on, merged
    from curvescan.mapping.grid_editing import joined

    if isinstance(one, curvescan.SlamMap) and isinstance(other, curvescan.SlamMap):
        return merged(one, other)
    grid, other_grid = _grid_of(one), _grid_of(other)
    return joined(grid, laid_on(grid, other_grid))


def _compared(one: AnyMap, later: AnyMap) -> list[Change]:
    """Return what changed, after the later map has been laid on the other."""
    from curvescan.editing import operations
    from curvescan.editing.merging import in_one_frame, laid_on

    try:
        if isinstance(one, curvescan.SlamMap) and isinstance(later, curvescan.SlamMap):
            one, later = in_one_frame(one, later)
        else:
            later = laid_on(_grid_of(one), _grid_of(later))
    except InvalidArgumentError as error:
        ERR.print(f"compared as they lie: {error}")
    return operations.changes(_grid_of(one), _grid_of(later))


def _write_changes(folder: Path, grid: OccupancyGrid, found: Sequence[Change]) -> None:
    """Write changes.csv and changes.png."""
    from curvescan.plots import colours
    from curvescan.plots.map import as_place, drawing_places

    with (folder / "changes.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("kind", "x_min", "y_min", "x_max", "y_max", "square_metres"))
        writer.writerows((c.kind, *(round(v, 4) for v in c.box), round(c.area, 4)) for c in found)
    cells = grid.occupied_centres
    with drawing_places(folder / "changes.png", cells) as [axes]:
        as_place(axes, f"{len(found)} changes: appeared in green, gone in red")
        axes.plot(*cells.T, "s", color=colours.DARK, ms=0.8, mew=0)
        for kind, (x0, y0, x1, y1) in ((change.kind, change.box) for change in found):
            colour = colours.TRUTH if kind == "appeared" else colours.PATH
            axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=colour, lw=1.5)


def view(
    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RESULTS")],
    other: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="OTHER")] = None,
    /,
    *,
    export: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html")] = None,
    host: str = "127.0.0.1",
    http_port: int | None = None,
) -> int:
    """Look at a finished run, or at two side by side: map, path, scans, and why each loop closure was accepted or not.

    The page is served until Ctrl-C. With --export it is written into one HTML file, which opens without a server.

    Parameters
    ----------
    results
        Results folder of `curvescan odometry`, `slam`, `localize` or `map`, or a map file (.csmap).
    other
        A second run, shown beside the first.
    export
        Write the page into this file instead.
    host
        Address to serve the page at; with 0.0.0.0 other machines can open it.
    http_port
        Port of the page; 8765, or a free one if that is in use.
    """
    from curvescan.live.finished.site import FinishedSite
    from curvescan.live.finished.view import view as view_runs
    from curvescan.live.server import PageServer

    page = view_runs(results, other)
    if export is not None:
        page.save(export)
        OUT.print(f"wrote {export}: {export.stat().st_size / 1e6:.1f} MB")
        return 0
    with PageServer(FinishedSite(page), host=host, port=free_port(host, http_port)) as server:
        ERR.print(f"the page is at {server.url}")
        open_browser(server.url)
        wait("Ctrl-C closes the page")
    return 0


def evaluate(
    trajectory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY")],
    /,
    *,
    relations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    reference: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    near: float = 5.0,
    tolerance: float = 0.01,
    benchmark: BenchmarkName | None = None,
    out: Path | None = None,
) -> int:
    """Measure a trajectory against relations of the Freiburg SLAM benchmark, or against reference poses.

    Relations (Kümmerle et al. 2009): translation and rotation errors of near, far and all relations, beside the
    published errors of the same log. Reference poses: absolute errors (ATE), relative errors (RPE) pose to pose and
    over each metre, and the drift for each metre travelled and each degree turned.

    Parameters
    ----------
    trajectory
        Poses of the laser: trajectory.tum or trajectory.csv, a results folder, or a log with poses.
    relations
        Relations of the robot: lines of t1 t2 x y z roll pitch yaw.
    reference
        Reference poses: TUM, CSV with columns stamp (or timestamp), x, y, theta, or a log with corrected poses.
    laser_pose
        Pose of the laser on the robot: metres, metres, degrees; for relations, and for references of the robot.
    near
        Longest time between the scans of a near relation, seconds.
    tolerance
        Largest difference of two stamps that belong together, seconds; for references. Equal stamps come first.
    benchmark
        Log whose published errors to print; by default the one that the relations file is named after.
    out
        Folder for evaluation.md, evaluation.json and two figures; without it nothing is written.
    """
    from curvescan.runs.evaluation import evaluate as measure
    from curvescan.runs.evaluation import tables_of

    if benchmark is not None and relations is None:
        raise InvalidArgumentError(f"--benchmark {benchmark} prints what was published of relations: give --relations")
    errors = measure(
        trajectory,
        relations=relations,
        reference=reference,
        laser_pose=in_radians(laser_pose),
        near=near,
        tolerance=tolerance,
        benchmark=benchmark,
        out=out,
    )
    notes, tables = tables_of(errors)
    for note in notes:
        OUT.print(with_flags(note))
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/evaluation.md, evaluation.json, errors.png, trajectory.png")
    return 0
