"""Batches over servers of S3 and of Google's storage in other processes: in, out, shared, killed, and resumed."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import pytest

import curvescan as cs
from curvescan.runs.batch.object_store import Bucket
from tests.conftest import ROOT
from tests.runs.batch.batch_jobs import CountedJob, NamedJob
from tests.runs.batch.gcs_server import gcs_server
from tests.runs.batch.s3_server import s3_server

pytest.importorskip("obstore", reason="needs obstore: pip install 'curvescan[cloud]'")


@pytest.fixture(scope="module", params=["s3", "gs"])
def server(request, tmp_path_factory):
    """A bucket's address, and the environment in which its server is found."""
    if request.param == "gs":
        with gcs_server(tmp_path_factory.mktemp("account")) as env:
            yield "gs://fleet", env
    else:
        pytest.importorskip("moto", reason="needs an S3 server: pip install 'moto[server]'")
        with s3_server() as env:
            yield "s3://fleet", env


@pytest.fixture
def bucket(server, monkeypatch, tmp_path):
    """The bucket, empty; temporary files go to a folder of the test."""
    address, env = server
    for name, value in env.items():
        monkeypatch.setenv(name, value)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    bucket = Bucket(address)
    for found in bucket.list(""):
        bucket.delete(found.key)
    return bucket


def put_logs(bucket, *names):
    for name in names:
        bucket.write(f"logs/{name}", b"x" * 10)


def keys(bucket, prefix):
    return sorted(found.key for found in bucket.list(prefix))


def by_name(result):
    return {record.input.rpartition("/")[2]: record for record in result.records}


def test_a_batch_from_a_bucket_into_a_bucket(bucket, tmp_path):
    put_logs(bucket, "a.log", "b-kill.log", "c-hang.log", "d-raise.log", "deep/a.log", "e.log")
    logs, out = f"{bucket.address}/logs/**/*.log", f"{bucket.address}/out/run"
    result = cs.run_batch(logs, out=out, job=NamedJob(), workers=2, timeout=3.0)
    records = by_name(result)
    assert [record.exit for record in result.records] == [0, 1, 1, 1, 0, 0]
    assert records["b-kill.log"].sentence.startswith("its worker process was ended by SIGKILL")
    assert "stopped after 3 s" in records["c-hang.log"].sentence
    assert records["d-raise.log"].sentence.startswith("RuntimeError: of no known kind")
    assert len({record.folder for record in result.records}) == 6
    for record in result.records:
        assert record.input.startswith(f"{bucket.address}/logs/")
        assert record.etag
        held = [f"out/run/{record.folder}/result"] * (not record.is_failed)
        assert keys(bucket, f"out/run/{record.folder}") == held
    table, _ = bucket.read("out/run/fleet.csv")
    rows = list(csv.DictReader(io.StringIO(table.decode())))
    assert [row["verdict"] for row in rows] == [record.verdict for record in result.records]
    lines = bucket.read("out/run/manifest.jsonl")[0].decode().splitlines()
    assert {json.loads(line)["input"] for line in lines} == {r.input for r in result.records}
    assert keys(bucket, "out/run/claims") == []
    (said,) = [key for key in keys(bucket, "out/run") if "workers-" in key]
    assert b"of no known kind" in bucket.read(said)[0]
    # the temporary files of the worker that was killed go when the next one begins; those of the others are gone
    cs.run_batch(f"{bucket.address}/logs/e.log", out=out, job=NamedJob(), workers=1)
    assert list((tmp_path / "tmp").iterdir()) == []


def test_resume_runs_what_has_another_content(bucket):
    put_logs(bucket, "a.log", "b.log")
    logs, out = f"{bucket.address}/logs/*.log", f"{bucket.address}/out"
    cs.run_batch(logs, out=out, job=NamedJob(), workers=2)
    started = time.perf_counter()
    again = cs.run_batch(logs, out=out, job=NamedJob(), resume=True)
    assert time.perf_counter() - started < 1.0
    assert again.n_skipped == 2
    put_logs(bucket, "a.log")  # newer, and the same
    assert cs.run_batch(logs, out=out, job=NamedJob(), resume=True).n_skipped == 2
    bucket.write("logs/a.log", b"y" * 10)  # as large, and another
    assert cs.run_batch(logs, out=out, job=NamedJob(), workers=1, resume=True).n_skipped == 1
    assert cs.run_batch(logs, out=out, job=NamedJob(option=1), resume=True).n_skipped == 0
    bucket.delete(f"out/{again.records[0].folder}/result")
    assert cs.run_batch(logs, out=out, job=NamedJob(option=1), resume=True).n_skipped == 1


def test_logs_here_and_results_there_and_the_other_way_round(bucket, tmp_path):
    put_logs(bucket, "a.log")
    (tmp_path / "b.log").write_text("x" * 20)
    logs = [f"{bucket.address}/logs/a.log", tmp_path / "b.log"]
    for out in (str(tmp_path / "out"), f"{bucket.address}/mixed"):
        result = cs.run_batch(logs, out=out, job=NamedJob(), workers=1)
        assert [record.exit for record in result.records] == [0, 0]
        assert {record.scans for record in result.records} == {10, 20}
    assert (tmp_path / "out" / "a" / "result").exists()
    assert len(keys(bucket, "mixed")) == 2 + 2 + 2  # results, records, manifest.jsonl and fleet.csv


def test_a_real_log_gives_the_same_bits_from_a_bucket(bucket, tmp_path):
    scans = cs.simulate("office", n_scans=5, seed=1)
    cs.write_log(tmp_path / "bag", scans)  # a ROS 2 bag: a folder
    for file in (tmp_path / "bag").iterdir():
        bucket.upload(file, f"logs/first floor/bag/{file.name}")
    result = cs.run_batch(f"{bucket.address}/logs/**", out=f"{bucket.address}/out", workers=1)
    assert [record.input for record in result.records] == [f"{bucket.address}/logs/first floor/bag"]
    assert [record.sentence for record in result.records if record.is_failed] == []
    cs.run(tmp_path / "bag", out=tmp_path / "alone")
    for name in ("trajectory.tum", "trajectory.csv", "map.pgm"):
        there, _ = bucket.read(f"out/{result.records[0].folder}/{name}")
        assert there == (tmp_path / "alone" / name).read_bytes()


_SUPERVISOR = """
import curvescan as cs
from tests.runs.batch.batch_jobs import CountedJob

cs.run_batch("{address}/logs/*.log", out="{address}/out", job=CountedJob(tally={tally!r}), workers=2, resume={resume})
"""


def start(bucket, tally, resume=True):
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    code = _SUPERVISOR.format(address=bucket.address, tally=str(tally), resume=resume)
    return subprocess.Popen([sys.executable, "-c", code], env=env, cwd=ROOT)


def runs(tally):
    """Return how often each log was begun, and by how many processes."""
    words = [line.split() for line in Path(tally).read_text().splitlines()]
    begun = [word for word in words if word[0] == "begin"]
    return Counter(word[1] for word in begun), {word[2] for word in begun}


@pytest.mark.parametrize("resume", [True, False])
def test_two_batches_at_once_share_the_logs(resume, bucket, tmp_path):
    put_logs(bucket, *(f"{k:02}-slow.log" for k in range(16)))
    tally = tmp_path / "tally"
    batches = [start(bucket, tally, resume), start(bucket, tally, resume)]
    assert [batch.wait(timeout=120) for batch in batches] == [0, 0]
    begun, workers = runs(tally)
    assert set(begun.values()) == {1}
    assert len(begun) == 16
    assert len(workers) > 2  # of both
    assert len(keys(bucket, "out/manifest")) == 16
    assert keys(bucket, "out/claims") == []


def test_a_killed_supervisor_is_resumed_at_once(bucket, tmp_path):
    put_logs(bucket, *(f"{k:02}-slow.log" for k in range(10)))
    tally = tmp_path / "tally"
    supervisor = start(bucket, tally)
    deadline = time.monotonic() + 60.0
    while len(keys(bucket, "out/manifest")) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    supervisor.send_signal(signal.SIGKILL)
    supervisor.wait()
    assert keys(bucket, "out/claims")  # nobody could give them up
    n_done = len(keys(bucket, "out/manifest"))
    started = time.monotonic()
    job = CountedJob(tally=str(tally))
    logs = f"{bucket.address}/logs/*.log"
    result = cs.run_batch(logs, out=f"{bucket.address}/out", job=job, workers=2, resume=True)
    assert time.monotonic() - started < 30.0  # half the lease: it is seen that their owner is gone
    assert result.n_skipped >= n_done
    assert [record.exit for record in result.records] == [0] * 10
    assert sum(runs(tally)[0].values()) <= 10 + 2
    assert keys(bucket, "out/claims") == []


def test_another_batch_with_other_options_is_refused(bucket):
    put_logs(bucket, "a.log")
    cs.run_batch(f"{bucket.address}/logs/a.log", out=f"{bucket.address}/out", job=NamedJob(), workers=1)
    (record,) = keys(bucket, "out/manifest")
    name = Path(record).stem
    claim = {"owner": "elsewhere:1:ab", "options": "other", "renewal": 1}
    bucket.write(f"out/claims/{name}.json", json.dumps(claim).encode())
    with pytest.raises(cs.OutputError, match="a batch with other options writes to the same folder"):
        cs.run_batch(f"{bucket.address}/logs/a.log", out=f"{bucket.address}/out", job=NamedJob(), workers=1)
    assert keys(bucket, "out/claims") == [f"out/claims/{name}.json"]


def test_what_is_not_there_is_a_sentence(bucket, tmp_path, monkeypatch):
    put_logs(bucket, "a.log")
    with pytest.raises(cs.InvalidArgumentError, match=r"no log matches '\w\w://fleet/logs/\*\.bag'"):
        cs.run_batch(f"{bucket.address}/logs/*.bag", out=tmp_path / "out", job=NamedJob())
    for name in ("AWS_ENDPOINT_URL", "GOOGLE_BASE_URL"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    with pytest.raises(cs.StorageError, match=r"cannot read \w\w://fleet/logs/a\.log: "):
        cs.run_batch(f"{bucket.address}/logs/a.log", out=tmp_path / "out", job=NamedJob())


def test_an_object_that_changes_while_it_is_read_is_an_error(bucket, tmp_path):
    put_logs(bucket, "a.log")
    (found,) = bucket.list("logs")
    bucket.write("logs/a.log", b"y" * 10)
    with pytest.raises(cs.StorageError, match="was changed or removed while it was read"):
        bucket.download(found, tmp_path / "a.log")
