"""curvescan demo and warm-up: a simulated building, and kernels compiled ahead of the first run."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import tyro

import curvescan
from curvescan.cli.console import ERR, OUT, run_display
from curvescan.cli.options import SensorName, SlamFlags, SlamRules, WorldName
from curvescan.io import output_folder
from curvescan.io.datasets import DATASETS, fetch

DatasetName: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="NAME")]


def demo(
    *,
    out: Annotated[Path, tyro.conf.arg(help="Folder for the results; made if it is missing.")] = Path("demo"),
    log: DatasetName = None,
    world: WorldName = "office-floor",
    sensor: SensorName = "urg-04lx",
    scans: int = 700,
    people: int = 0,
    seed: int = 0,
    rules: SlamRules = SlamFlags(),  # noqa: B008 - frozen
) -> int:
    """Drive a simulated robot in a loop through a building, close the loop, and compare with the truth.

    Writes what `slam` writes, and loop.png: the map of the odometry alone beside the one whose loop is closed. Prints
    the errors of SLAM, of laser odometry and of wheel odometry.

    Parameters
    ----------
    log
        A public log instead of the simulated building. It is downloaded on its first use, mapped as `curvescan slam`
        does it, and compared with its relations, if there are any.
    world
        The simulated world.
    sensor
        The simulated sensor.
    scans
        Number of scans.
    people
        Number of people who walk around the robot.
    seed
        Random seed; selects the building and the route.
    """
    if log is not None:
        return _map_public_log(log, out, rules)
    return _map_simulation(out, rules, world=world, sensor=sensor, n_scans=scans, n_people=people, seed=seed)


def _map_simulation(out: Path, rules: SlamFlags, **options: Any) -> int:
    from curvescan.cli.summary import errors_of, report
    from curvescan.plots.map import draw_side_by_side
    from curvescan.runs.results import list_further_files

    with ERR.status("simulating"):
        simulation = curvescan.simulate(**options)
    matching, truth = rules.matching, simulation.truth.poses
    with run_display() as display:
        result = curvescan.run(
            replace(simulation, odometry=None),  # the scans are enough
            "slam",
            out=out,
            method=matching.method,
            matcher=matching.matcher,
            config=rules.slam,
            truth=truth,
            command=sys.argv,
            display=display,
        )
        display.begin("drawing the maps", 0)
        record = result.record
        tracks = {"laser odometry": record.odometry.poses, "SLAM, loops closed": result.trajectory.poses}
        with output_folder(out) as folder:
            draw_side_by_side(folder / "loop.png", simulation, tracks, truth)
            list_further_files(folder, out)
    result = replace(result, files=tuple(sorted((*result.files, "loop.png"))))
    truth = truth[: len(record.outcomes)]
    if len(truth) > 1:
        if simulation.odometry is not None:
            tracks["wheel odometry"] = simulation.odometry.poses[: len(truth)]
        OUT.print(errors_of(tracks, truth))
    return report(result, out)


def _map_public_log(name: str, out: Path, rules: SlamFlags) -> int:
    from curvescan.cli.commands.results import evaluate
    from curvescan.cli.commands.slam import slam

    with ERR.status(f"fetching {name}"):
        log = fetch(name)
        relations = fetch(f"{name}.relations") if f"{name}.relations" in DATASETS else None
    status = slam(log, out=out, rules=rules)
    if relations is not None:
        evaluate(out, relations=relations)
    return status


def warm_up(*, cache: Path | None = None, processor: Literal["generic", "native"] = "generic") -> int:
    """Compile the kernels of matching, odometry, SLAM and maps, so that no later run waits for a compiler.

    Parameters
    ----------
    cache
        Folder for machine code to copy into an image or a package; NUMBA_CACHE_DIR names it there. Code for another
        Python, Numba or kind of processor is ignored. By default the cache of this machine is filled.
    processor
        Processor that the code in --cache is for: `generic` runs on any of this kind (6 % slower, the same results),
        `native` on this one alone.
    """
    seconds = curvescan.warm_up(cache=cache, processor=processor)
    OUT.print(f"compiled or loaded in {seconds:.1f} s" + (f": {cache}" if cache else ""))
    return 0
