"""Warm-up: what a robot needs is compiled before it moves, and nothing after."""

from __future__ import annotations

import gc
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import curvescan as cs
from curvescan import _compilation
from tests.test_kernel_cache import N_COMPILED

# a process of its own: what other tests have loaded would hide what the warm-up leaves out
BEGIN = """
from dataclasses import replace
import curvescan as cs
from curvescan import _jit
from curvescan.simulation import SENSORS, simulate

def variants():
    return {
        (k.py_func.__module__ + "." + k.py_func.__name__, str(signature))
        for k in _jit._kernels
        for signature in k.signatures
    }
"""
DRIVE = """
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.run_maps import build_maps
from curvescan.engines import run_engine
from curvescan.slam.loops.agreement import _clique
from curvescan.slam.loops.cycles import cycle_distances
from curvescan.slam.open_direction import _count

sensor = replace(SENSORS["spinning-360"], time_increment=0.1 / 360)
# a loop, a leap to where it has not been, and back: failures and recovery
sim = simulate("office", sensor=sensor, n_scans=220, n_people=2, seed=1)
rows = [*range(60), *range(190, 220), *range(30, 90)]
scans, wheels = [sim[i] for i in rows], sim.odometry.poses[rows]
cs.warm_up()
before = variants()
# of closures that wait for others, and of those along corridors: the drive below may need none of them
assert [len(k.signatures) for k in (_clique, cycle_distances, _count)] == [1, 1, 1]
run_engine(scans, cs.Odometry(), odometry_poses=wheels)
run = run_engine(scans, cs.Odometry())
assert {"PREDICTED", "LOST", "MATCHED"} <= {o.name for o in run.outcomes}
build_maps(scans, run.trajectory.poses, run.is_joined, occupancy=OccupancyConfig())
sick = simulate("corridor", n_scans=30, n_people=2)
run_engine(sick, cs.Odometry())
for i in range(0, 25, 5):
    cs.match(sick[i], sick[i + 4])
    cs.match(sick[i], sick[i + 4], guess=(0.3, 0.0, 0.0))
    cs.match(sick[i], scans[i])
slam = cs.Slam()
for scan in scans:
    slam.add(scan)
assert len(slam.finish()) == len(scans)
localizer = cs.Localizer(slam.map)
assert any(localizer.add(scan).ok for scan in scans[:40])
print(*sorted(variants() - before))
"""


def run(code):
    done = subprocess.run([sys.executable, "-c", BEGIN + code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_a_drive_after_the_warm_up_compiles_and_loads_nothing():
    assert run(DRIVE) == ""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["cfsma", "idc"])
def test_after_the_warm_up_of_a_method_its_matches_load_nothing(method):
    code = f"""
sim = simulate("office", n_scans=6)
cs.warm_up({method!r})
before = variants()
cs.match(sim[0], sim[5], method={method!r})
print(*sorted(variants() - before))
"""
    assert run(code) == ""


def test_what_is_unknown_or_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(cs.InvalidArgumentError, match="unknown"):
        cs.warm_up("slam")
    with pytest.raises(cs.InvalidArgumentError, match="processor must be one of generic, native, got 'pentium'"):
        cs.warm_up(cache=tmp_path, processor="pentium")
    with pytest.raises(cs.InvalidArgumentError, match="processor must be one of generic, native, got 'pentium'"):
        cs.warm_up(processor="pentium")
    (tmp_path / "file").write_text("")
    with pytest.raises(cs.OutputError, match="cannot be written"):
        cs.warm_up(cache=tmp_path / "file" / "kernels")


@pytest.mark.slow
def test_a_cache_for_any_processor_serves_a_package_that_lies_elsewhere(tmp_path):
    cs.warm_up("cfsma", slam=False, cache=tmp_path / "kernels")
    site = tmp_path / "site"
    shutil.copytree(Path(cs.__file__).parent, site / "curvescan", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.move(tmp_path / "kernels", site / "curvescan" / "_kernels")
    code = f"""
sim = simulate("office", n_scans=6)
results = [cs.match(sim[0], sim[5], method="cfsma").pose.tolist()]
odometry = cs.Odometry("cfsma")
results += [odometry.add(scan).pose.tolist() for scan in sim]
print({N_COMPILED}, results)
"""
    env = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    env |= {"PYTHONPATH": str(site), "XDG_CACHE_HOME": str(tmp_path / "user")}
    done = subprocess.run([sys.executable, "-c", BEGIN + code], env=env, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    # the bits of code for this processor
    assert done.stdout.strip() == "0 " + run(code).partition(" ")[2]


@pytest.mark.slow
def test_the_seconds_are_returned():
    assert 0.0 < cs.warm_up() < 600.0


def test_what_takes_long_is_told_once_with_its_time(caplog, monkeypatch):
    clock = iter([0.0, 0.4, 1.4, 10.0, 10.5])
    monkeypatch.setattr(_compilation, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    watch = _compilation.CompilationWatch()
    with caplog.at_level(logging.WARNING, logger="curvescan"):
        watch.start()
        watch.start()
        watch.end()
        assert caplog.messages == []
        watch.end()
        assert caplog.messages == ["curvescan compiles its kernels, in the first run only ..."]
        watch.report()  # of a match that compiled: more may follow
        assert len(caplog.messages) == 1
        watch.report()
        assert caplog.messages[1:] == ["curvescan compiled its kernels in 1.4 s"]
        watch.start()
        watch.end()
        watch.report(is_over=True)
    assert len(caplog.messages) == 2


def test_what_is_held_is_one_wait_with_one_total(caplog, monkeypatch):
    clock = iter([0.0, 2.0, 3.0, 6.0])
    monkeypatch.setattr(_compilation, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    watch = _compilation.CompilationWatch()
    with caplog.at_level(logging.WARNING, logger="curvescan"), watch.held():
        for _ in range(2):
            with watch.held():
                watch.start()
                watch.end()
                watch.report()
        watch.report()
        assert len(caplog.messages) == 1
    assert caplog.messages[1:] == ["curvescan compiled its kernels in 5.0 s"]


def test_the_garbage_collector_halts_for_the_outermost_compilation_alone():
    watch = _compilation.CompilationWatch()
    watch.start()
    watch.start()
    watch.end()
    assert not gc.isenabled()
    watch.end()
    assert gc.isenabled()
    gc.disable()
    try:
        watch.start()
        watch.end()
        assert not gc.isenabled()
    finally:
        gc.enable()
