"""Batches on a real Ray cluster of this machine: the same results, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

import curvescan as cs
from tests.conftest import ROOT
from tests.runs.batch.batch_jobs import NamedJob, UnloadableJob
from tests.runs.batch.s3_server import s3_server
from tests.runs.batch.test_batch import by_name, is_alive, make_logs

ray = pytest.importorskip("ray", reason="needs Ray: pip install 'curvescan[ray]'")
pytestmark = pytest.mark.filterwarnings("default")  # Ray's own are no business of ours


@pytest.fixture(scope="module")
def cluster():
    """A cluster of two cores; its processes find this package and these tests."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    ray.init(num_cpus=2, log_to_driver=False, include_dashboard=False, logging_level="error")
    yield
    ray.shutdown()
    os.environ.pop("PYTHONPATH")
    if before is not None:
        os.environ["PYTHONPATH"] = before


def test_one_bad_log_stops_no_other(cluster, tmp_path):
    names = ["a.log", "b-kill.log", "c-hang.log", "d-raise.log", "e-exit.log", "g-odd.log", "h.log"]
    logs = make_logs(tmp_path / "logs", *names)
    result = cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), engine="ray", timeout=4.0)
    records = by_name(result)
    assert [r.exit for r in result.records] == [0, 1, 1, 1, 1, 3, 0]
    assert records["b-kill.log"].sentence.startswith("its Ray worker ended: ")
    assert "stopped after 4 s" in records["c-hang.log"].sentence
    assert records["d-raise.log"].sentence.startswith("RuntimeError: of no known kind")
    assert "of no known kind" in (tmp_path / "out" / "workers.log").read_text()
    pids = {
        int((tmp_path / "out" / r.folder / "result").read_text().split()[1]) for r in result.records if not r.is_failed
    }
    assert os.getpid() not in pids
    deadline = time.monotonic() + 10.0
    while any(map(is_alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(is_alive, pids))
    assert ray.is_initialized()  # the caller's cluster stays the caller's


def test_workers_live_longer_than_a_log_and_resume_is_the_same(cluster, tmp_path):
    logs, out = make_logs(tmp_path / "logs", *(f"{k}.log" for k in range(8))), tmp_path / "out"
    result = cs.run_batch(logs, out=out, job=NamedJob(), engine="ray")
    pids = {(out / record.folder / "result").read_text().split()[1] for record in result.records}
    assert 1 <= len(pids) <= 2
    # an engine is no option of the job: what one has run stands for the other
    assert cs.run_batch(logs, out=out, job=NamedJob(), resume=True).n_skipped == 8


def test_a_real_log_gives_the_same_bits(cluster, tmp_path):
    cs.write_log(tmp_path / "office.npz", cs.simulate("office", n_scans=6, seed=1))
    log = tmp_path / "office.npz"
    result = cs.run_batch(log, out=tmp_path / "ray", engine="ray")
    assert [record.sentence for record in result.records if record.is_failed] == []
    cs.run_batch(log, out=tmp_path / "local", workers=1)
    for name in ("trajectory.tum", "trajectory.csv", "map.pgm"):
        there = (tmp_path / "ray" / "office" / name).read_bytes()
        assert there == (tmp_path / "local" / "office" / name).read_bytes()


def test_workers_that_cannot_begin_end_the_batch(cluster, tmp_path):
    logs = make_logs(tmp_path / "logs", "a.log")
    with pytest.raises(cs.WorkerError, match="this machine lacks a part of it"):
        cs.run_batch(logs, out=tmp_path / "out", job=UnloadableJob(), engine="ray")


def test_a_cluster_and_a_bucket(tmp_path):
    pytest.importorskip("obstore", reason="needs obstore: pip install 'curvescan[cloud]'")
    pytest.importorskip("moto", reason="needs an S3 server: pip install 'moto[server]'")
    code = (
        "import curvescan as cs; from tests.runs.batch.batch_jobs import NamedJob;"
        "result = cs.run_batch('s3://fleet/logs/*', out='s3://fleet/out', job=NamedJob(), engine='ray', workers=2);"
        "print([record.exit for record in result.records])"
    )
    with s3_server() as server:
        os.environ.update(server)
        try:
            from curvescan.runs.batch.object_store import Bucket

            bucket = Bucket("s3://fleet")
            for name in ("a.log", "b-kill.log", "c.log"):
                bucket.write(f"logs/{name}", b"x")
            env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
            done = subprocess.run([sys.executable, "-c", code], env=env, cwd=ROOT, capture_output=True, text=True)
        finally:
            for name in server:
                del os.environ[name]
    assert done.stdout.endswith("[0, 1, 0]\n"), done.stderr  # Ray tells of the dead worker first


_SUPERVISOR = """
import signal

import curvescan as cs

signal.signal(signal.SIGINT, signal.default_int_handler)
from tests.runs.batch.batch_jobs import NamedJob
cs.run_batch({logs!r}, out={out!r}, job=NamedJob(), engine="ray", workers=2)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_is_ended_leaves_no_workers_and_is_resumed(how, tmp_path):
    logs, out = (make_logs(tmp_path / "logs", *(f"{k}-slow.log" for k in range(12))), tmp_path / "out")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    code = _SUPERVISOR.format(logs=str(logs), out=str(out))
    supervisor = subprocess.Popen(
        [sys.executable, "-c", code],
        env=env, cwd=ROOT, start_new_session=True, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while len(list(out.glob("*/result"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    pids = {int(path.read_text().split()[1]) for path in out.glob("*/result")}
    assert pids
    os.kill(supervisor.pid, how)
    supervisor.wait(timeout=60)
    deadline = time.monotonic() + 30.0
    while any(map(is_alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(is_alive, pids))
    result = cs.run_batch(logs, out=out, job=NamedJob(), workers=2, resume=True)
    assert 1 <= result.n_skipped < 12
    assert [record.exit for record in result.records] == [0] * 12
