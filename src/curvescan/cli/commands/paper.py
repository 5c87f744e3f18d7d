"""curvescan calibrate, experiments and bench: the paper's parameters, its experiments, matchers measured here."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from curvescan.cli.console import ERR, OUT, load_methods, run_display, show
from curvescan.cli.options import LaserPose, SensorName, in_radians
from curvescan.errors import InvalidArgumentError
from curvescan.io import output_folder, read_log, read_relations, write_config
from curvescan.runs.document import ResultTable

if TYPE_CHECKING:
    from curvescan.se2.uncertain import UncertainPose


def calibrate(
    log: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[LOG]")] = None,
    /,
    *,
    out: Path | None = None,
    mounts: bool = False,
    sensor: SensorName = "sick-lms200-5mm",
    distances: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0),
    range_max: float | None = None,
    seed: int = 0,
) -> int:
    """Find the parameters of the method cfsma for a sensor, as the paper did for its own; only lambda is not searched.

    sigma_rho keeps a wall beside the sensor in one segment. U_k and U_p are the smallest values at which the curvature
    of a plane shows no peak. The curvature of a plane is noise, and U_c lies just above the correlation that such noise
    has. n is the smallest number of neighbours that matches simulated consecutive scans as well as any other. S_min is
    the largest similarity that rejects no right pair of corners. Walls, corners and pairs are always simulated, with
    the noise that the planes show.

    Writes cfsma.toml for --config, calibration.png and calibration.md.

    With --mounts it finds where the lasers of a bag sit on the robot, from their scans and the wheels. It names
    the mounts of the bag's transforms that are wrong.

    Parameters
    ----------
    log
        Log of a sensor in front of bare walls; without it, walls are simulated.
    out
        Folder for the results; made if it is missing. Default: ./calibration.
    mounts
        Find the mounts of the lasers of LOG, a bag; nothing is written.
    sensor
        The simulated sensor, where there is no log.
    distances
        Distances of the simulated planes, metres.
    range_max
        Upper limit of a valid reading of the log, metres, in place of what the log says.
    seed
        Seed of the simulated noise.
    """
    if mounts:
        return _show_mounts(log)
    return _find_parameters(log, out or Path("calibration"), sensor, distances, range_max, seed)


def _find_parameters(
    log: Path | None, out: Path, sensor: str, distances: tuple[float, ...], range_max: float | None, seed: int
) -> int:
    from curvescan.paper.calibration import calibrate as find_parameters
    from curvescan.paper.calibration import planes_of_log, sensor_of_log, simulated_planes
    from curvescan.paper.calibration_report import calibration_tables, draw_calibration
    from curvescan.simulation.sensing.sensors import choose_sensor

    if log is None:
        source, planes = choose_sensor(sensor), None
    else:
        recording = read_log(log, range_max=range_max)
        source, planes = sensor_of_log(recording), planes_of_log(recording, recording.name)
    with output_folder(out) as folder, ERR.status("scanning planes and corners"):
        if planes is None:
            planes = simulated_planes(source, distances, seed=seed)
        found = find_parameters(planes, source, seed=seed)
        write_config(folder / "cfsma.toml", {"cfsma": found.config})
        draw_calibration(folder / "calibration.png", found)
        tables = calibration_tables(found)
        text = "\n".join(table.markdown() for table in tables)
        (folder / "calibration.md").write_text(text, encoding="utf-8", newline="\n")
    for table in tables:
        show(table)
    for group, is_free in zip(found.groups, found.is_free, strict=True):
        if not is_free:
            OUT.print(
                f"planes at {group.name} show peaks at every U_k and were left out of the choice: "
                "their readings lie closer together than the noise"
            )
    OUT.print(f"wrote {out}/cfsma.toml, calibration.png, calibration.md")
    return 0


def _show_mounts(log: Path | None) -> int:
    """Print the mounts of a bag's lasers; 3 where one of the transforms is wrong."""
    from curvescan.evaluation.mounts import check_mounts

    if log is None:
        raise InvalidArgumentError("--mounts needs the bag: curvescan calibrate LOG --mounts")
    checks = check_mounts(log)
    show(
        ResultTable.of(
            "Mounts of the lasers, from their scans",
            checks,
            [
                ("laser", lambda check: check.topic),
                ("seen from", lambda check: check.base),
                ("x, m", lambda check: _measured(check.found, 0, digits=3)),
                ("y, m", lambda check: _measured(check.found, 1, digits=3)),
                ("yaw, deg", lambda check: _measured(check.found, 2, scale=math.degrees(1.0), digits=2)),
                ("by the transforms", lambda check: "-" if check.given is None else _given(*check.given)),
                (
                    "transforms are",
                    lambda check: "-" if check.given is None else "wrong" if check.is_wrong else "right",
                ),
            ],
        )
    )
    if any(check.is_wrong for check in checks):
        OUT.print("a mount of the bag's transforms contradicts the scans: correct it there, or walls are doubled")
        return 3
    return 0


def _measured(found: UncertainPose, k: int, *, digits: int, scale: float = 1.0) -> str:
    sigma = math.sqrt(found.covariance[k, k])
    return f"{found.pose[k] * scale:.{digits}f} ± {sigma * scale:.{digits}f}"


def _given(x: float, y: float, yaw: float) -> str:
    return f"{x:.3f}, {y:.3f}, {math.degrees(yaw):.2f}"


def experiments(
    *,
    out: Path,
    logs: tuple[Path, ...] = (),
    relations: tuple[Path, ...] = (),
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    only_logs: bool = False,
    quick: bool = False,
    seed: int = 0,
) -> int:
    """Run the paper's five experiments with every method, and report them beside the paper's figures.

    Writes report.html (self-contained), report.md, results.json and the figures. The same seed gives the same numbers
    to the last digit, times aside.

    Parameters
    ----------
    out
        Folder for the report; made if it is missing.
    logs
        Real logs on which every method is run too: errors, failures and milliseconds a scan.
    relations
        Relations of the Freiburg SLAM benchmark; their time stamps tell which log each file belongs to.
    laser_pose
        Pose of the laser on the robot for the relations: metres, metres, degrees.
    only_logs
        Run the methods on the real logs alone, without the paper's experiments on simulated scans.
    quick
        Run only a tenth of the runs and a quarter of the scans, as a check.
    seed
        Seed of all simulated scans.
    """
    from curvescan.paper.experiments import run_experiments
    from curvescan.paper.report import save_experiments

    mount = in_radians(laser_pose)
    sources = [read_log(path) for path in logs]
    known = [read_relations(path) for path in relations]
    with output_folder(out) as folder:
        load_methods()
        with run_display("steps") as display:
            results = run_experiments(
                logs=sources,
                relations=known,
                laser_pose=mount,
                only_logs=only_logs,
                is_quick=quick,
                seed=seed,
                progress=display.begin,
            )
        with ERR.status("drawing and writing the report"):
            save_experiments(folder, results)
    OUT.print(f"wrote {out}/report.html, report.md, results.json")
    return 0


def bench(
    *, pairs: int = 300, runs: int = 1000, seed: int = 0, logs: tuple[Path, ...] = (), out: Path | None = None
) -> int:
    """Measure the matchers: time a match, success and accuracy on pairs, experiment 1, failures on real logs.

    Pairs: two scans of an office, a random motion apart, no guess; a match within 0.1 m and 2 deg is a success. The
    bound is the median translation error that the Cramér-Rao bound allows; NEES is 3 where covariances are right.

    Experiment 1: a scan matched with one moved by a random transform (0.1 m on each axis and 15 deg in the mean). Its
    variants: the paper's, where both scans are taken from one place and the second is moved on paper, without and
    with people; and the robot's, where the second is taken from the other place.

    Parameters
    ----------
    pairs
        Pairs of scans in each scenario; times are taken on as many, at most 200.
    runs
        Runs of each variant and world of experiment 1, a multiple of 5.
    seed
        Seed of all simulated scans; the same seed gives the same errors.
    logs
        Real logs; each scan is matched with the one before; compared with the poses in the log.
    out
        Folder for bench.md; without it nothing is written.
    """
    from curvescan.benchmarks.benchmark import run_benchmark

    sources = [read_log(path) for path in logs]
    with nullcontext() if out is None else output_folder(out) as folder:
        load_methods()
        with run_display("steps") as display:
            tables = run_benchmark(n_pairs=pairs, n_runs=runs, logs=sources, seed=seed, progress=display.begin)
        if folder is not None:
            text = "\n".join(table.markdown() for table in tables)
            (folder / "bench.md").write_text(text, encoding="utf-8", newline="\n")
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/bench.md")
    return 0
