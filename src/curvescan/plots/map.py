"""Maps as pictures: of a run, of wheels alone (the paper's figure 7), of occupancy and graphs; what figures share."""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure

from curvescan import se2
from curvescan.engines import RunRecord
from curvescan.io.files.lines import printable
from curvescan.io.log import Log
from curvescan.mapping.occupancy import Blocks
from curvescan.mapping.occupied_cells import occupied_cells
from curvescan.mapping.run_maps import RunMaps
from curvescan.odometry.step import IN_MAP
from curvescan.plots.colours import DARK, FAILED, GREY, LIGHT, PAIRED, PATH, TRUTH, WHEELS
from curvescan.slam.loops.closures import is_loop
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Points, Pose

_STYLE = Path(__file__).with_name("curvescan.mplstyle")
_DPI = 150
_MAX_TITLE = 160


@contextmanager
def drawing(path: Path, width: float, height: float, *, legend: int = 0) -> Iterator[Figure]:
    """Yield an empty figure of that many inches and save it when the block ends, with a legend of so many columns."""
    # given as a file it would cost a quarter of a second: Matplotlib reads its thirty styles first
    style: Any = {name: value for name, value in mpl.rc_params_from_file(_STYLE).items() if name != "backend"}
    with mpl.rc_context(style):
        figure: Any = FigureCanvasAgg(Figure(figsize=(width, height), layout="constrained")).figure
        yield figure
        known: dict[str, Any] = {}  # what several axes show stands in the legend once
        for axes in figure.axes:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                known.setdefault(label, handle)
        if legend and known:
            figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=legend)
        with warnings.catch_warnings():
            # names of files may be in any script; a box stands for what the font does not have
            warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
            # laid out here: with bbox_inches="tight" Matplotlib draws twice, once to see how large it is
            figure.set_dpi(_DPI)
            figure.get_layout_engine().execute(figure)
            figure.set_layout_engine(None)
            box = figure.get_tightbbox().padded(0.1)
            figure.savefig(path, dpi=_DPI, bbox_inches=box, pil_kwargs={"compress_level": 3})


@contextmanager
def drawing_places(path: Path, points: Points, n_places: int = 1, *, legend: int = 0) -> Iterator[list[Axes]]:
    """Yield the axes of a figure of `n_places` maps of one size, wide ones above each other; saved as by `drawing`."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.03 * float(max(high - low)) + 0.1
    low, high = low - margin, high + margin
    span = high - low
    ratio = float(np.clip(span[1] / span[0], 0.2, 2.0))
    is_wide = n_places > 1 and ratio < 0.6
    rows, columns = (n_places, 1) if is_wide else (1, n_places)
    width = 11.0 / columns if n_places > 1 else min(10.0, max(7.0, 9.0 / ratio))
    with drawing(path, columns * width, rows * ((width - 0.5) * ratio + 0.5) + 1.0, legend=legend) as figure:
        places = np.ravel(figure.subplots(rows, columns)).tolist()
        for axes in places:
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        yield places


def as_place(axes: Axes, title: str = "") -> None:
    """Make axes a map: metres on both, at the same scale."""
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    if title:  # often the name of a file, in which a $ begins no formula
        axes.set_title(printable(title, _MAX_TITLE), parse_math=False)


def draw_truth(axes: Axes, poses: Pose) -> None:
    """Draw the true path, (n, 3) poses."""
    axes.plot(*poses[:, :2].T, color=TRUTH, lw=1.0, ls="--", label="truth")


def mark_ends(axes: Axes, poses: Pose, colour: str = PATH) -> None:
    """Mark where a path of (n, 3) poses starts and ends; nothing where it has none."""
    for mark, end, label in (("o", poses[:1], "start"), ("s", poses[-1:], "end")):
        if len(end):
            axes.plot(*end[:, :2].T, mark, color="white", mec=colour, mew=1.4, ms=6, label=label)


def draw_map(path: Path, run: RunRecord, place: RunMaps, *, title: str, truth: Pose | None = None) -> None:
    """Save the map of a run as a picture; truth (>= n, 3)."""
    poses = run.trajectory.poses
    known = poses[np.isfinite(poses[:, 0])]
    failed = run.is_failed & np.isfinite(poses[:, 0])
    cells, moved_cells = place.standing, place.moved
    is_localized = not {*IN_MAP[:-1]}.isdisjoint(run.outcomes)
    true_poses = None if truth is None else from_first(truth[: len(poses)])
    everything = [cells, moved_cells, poses[:, :2], np.zeros((1, 2))]
    with drawing_places(path, np.concatenate(everything), legend=3) as [axes]:
        as_place(axes, title if len(known) else f"{title}: not found in the map")
        draw_cells(axes, moved_cells, GREY, "moved while the sensor passed")
        draw_cells(axes, cells, DARK, "saved map" if is_localized else "map from scan matching")
        if true_poses is not None:
            draw_truth(axes, true_poses)
        if len(known):
            label = "path in the saved map" if is_localized else "scan matching"
            axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label=label)
        if failed.any():
            label = f"match failed ({np.count_nonzero(failed):,} of {max(len(poses) - 1, 1):,})"
            axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=3.5, mew=0.8, label=label)
        mark_ends(axes, known)


def draw_wheels(path: Path, cells: Points, poses: Pose, *, title: str) -> None:
    """Save the map, (k, 2) cells, that a log's wheel odometry alone, poses (n, 3), makes of its scans."""
    with drawing_places(path, np.concatenate([cells, poses[:, :2]]), legend=2) as [axes]:
        as_place(axes, title)
        draw_cells(axes, cells, DARK, "map from wheel odometry")
        axes.plot(*poses[:, :2].T, color=WHEELS, lw=1.0, label="wheel odometry")


def from_first(poses: Pose) -> Pose:
    """Return poses seen from the first one that is known."""
    known = np.flatnonzero(~np.isnan(poses[:, 2]))
    return se2.between(poses[known[0]], poses) if known.size else poses


def draw_cells(axes: Axes, cells: Points, colour: str, label: str) -> None:
    """Draw (k, 2) cells of 0.05 m on the axes of a map; of none nothing, and no legend."""
    if len(cells):
        axes.plot(*cells.T, "s", color=colour, ms=_on_paper(axes, 0.05), mew=0)
        axes.plot([], [], "s", color=colour, ms=4, mew=0, label=label)


def _on_paper(axes: Axes, metres: float) -> float:
    """Return how long so many metres are on the axes of a map, points, and a pixel more: marks snap to pixels."""
    width = axes.bbox.width / axes.figure.dpi
    width *= 1.2  # the layout will widen the axes so
    return 72.0 * (width * metres / float(np.ptp(axes.get_xlim())) + 1.0 / _DPI)


def draw_side_by_side(path: Path, log: Log, tracks: Mapping[str, Pose], truth: Pose | None = None) -> None:
    """Save a picture of the maps that the same scans make under several trajectories; truth (>= n, 3)."""
    poses = {title: from_first(track) for title, track in tracks.items()}
    cells = {title: occupied_cells(log, track) for title, track in poses.items()}
    everything = [*cells.values(), *(track[:, :2] for track in poses.values())]
    with drawing_places(path, np.concatenate(everything), len(tracks), legend=5) as places:
        for axes, (title, track) in zip(places, poses.items(), strict=True):
            as_place(axes, title)
            draw_cells(axes, cells[title], DARK, "where readings ended")
            if truth is not None:
                draw_truth(axes, from_first(truth[: len(track)]))
            axes.plot(*track[:, :2].T, color=PATH, lw=1.0, label="trajectory")
            mark_ends(axes, track)


def draw_graph(path: Path, slam_map: SlamMap, cells: Points, refused: Points, *, title: str) -> None:
    """Save the pose graph of a map as a picture. cells (k, 2); refused (c, 2): where matches contradict it."""
    is_closure = np.asarray(slam_map.kinds >= EdgeKind.CLOSURE)
    is_used = np.asarray(slam_map.weights > 0.5)
    sessions = np.asarray(slam_map.sessions)[slam_map.ends]
    closes = is_loop(slam_map.ends[:, 0], slam_map.ends[:, 1]) | (sessions[:, 0] != sessions[:, 1])
    with drawing_places(path, np.concatenate((cells, slam_map.poses[:, :2])), legend=3) as [axes]:
        as_place(axes, title)
        draw_cells(axes, cells, GREY, "map from scan matching")
        for chosen, colour, label in (
            (is_closure & is_used & closes, PAIRED, "loop closures"),
            (is_closure & is_used & ~closes, LIGHT, "matches of neighbours"),
            (is_closure & ~is_used, FAILED, "without weight"),
            (~is_closure & is_used, PATH, "keyframes that follow each other"),
        ):
            if chosen.any():
                lines = list(slam_map.poses[slam_map.ends[chosen], :2])
                axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.4))
                axes.plot([], [], color=colour, lw=1.0, label=f"{label} ({len(lines):,})")
        size = min(_on_paper(axes, 0.1), 4.0)
        axes.plot(*slam_map.poses[:, :2].T, "o", color=DARK, ms=size, mew=0)
        axes.plot([], [], "o", color=DARK, ms=4, mew=0, label=f"keyframes ({len(slam_map.poses):,})")
        if len(refused):
            axes.plot(*refused.T, "o", color=FAILED, mfc="none", ms=18, label="contradicted by matches")


_COLOURS = {"unknown": "#c4c7cc", "free": "#ffffff", "occupied": DARK}  # by the rank of a block


def draw_occupancy(path: Path, blocks: Blocks, poses: Pose, *, title: str) -> None:
    """Save an occupancy map as a picture, and the path of its poses (n, 3)."""
    with drawing_places(path, blocks.corners, legend=4) as [axes]:
        as_place(axes, title)
        draw_grid(axes, blocks)
        axes.plot(*poses[:, :2].T, color=PATH, lw=0.7, label="path of the sensor")


def draw_grid(axes: Axes, blocks: Blocks) -> None:
    """Draw an occupancy map on axes, whose limits become the map's."""
    (left, bottom), (right, top) = blocks.corners
    colours = np.rint(255 * to_rgba_array(list(_COLOURS.values()))).astype(np.uint8)
    axes.grid(visible=False)
    axes.imshow(
        colours[blocks.ranks],  # a colour map of Matplotlib's takes 60 MB more
        extent=(left, right, bottom, top),
        origin="lower",
        interpolation="nearest",  # a block is a pixel or more: none is left out
    )
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for label, colour in _COLOURS.items():
        axes.plot([], [], "s", color=colour, mec="black", mew=0.4, ms=6, label=label)
