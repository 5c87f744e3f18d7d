"""URLs, patterns of objects, claims, and what is said where an extra is missing; without any server."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import curvescan as cs
from curvescan.cli.main import run as command
from curvescan.io.files.output import HIDDEN_PREFIX
from curvescan.runs.batch import worker
from curvescan.runs.batch.logs import _matches, name_folders, unique_name
from curvescan.runs.batch.object_store import Bucket, Claims, is_url, split_url
from tests.runs.batch.batch_jobs import NamedJob


@pytest.fixture
def bucket():
    pytest.importorskip("obstore", reason="needs obstore: pip install 'curvescan[cloud]'")
    return Bucket("memory://")


@pytest.mark.parametrize("where", ["patterns", "out"])
def test_without_the_extra_buckets_are_refused_in_a_sentence(where, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    (tmp_path / "a.log").write_text("x")
    arguments = {"patterns": str(tmp_path / "*.log"), "out": str(tmp_path / "out")}
    arguments[where] = "s3://fleet/logs"
    with pytest.raises(cs.MissingPackageError, match=r"pip install 'curvescan\[cloud\]'"):
        cs.run_batch(arguments.pop("patterns"), **arguments, job=NamedJob())


def test_without_the_extra_a_cluster_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    (tmp_path / "a.npz").write_text("x")
    words = ["batch", str(tmp_path / "a.npz"), "--out", str(tmp_path / "out"), "--engine", "ray"]
    assert command(words) == 1
    assert "pip install 'curvescan[ray]'" in capsys.readouterr().err


@pytest.mark.parametrize("url", ["http://fleet/logs", "s3://", "s3:///logs", "file:///tmp"])
def test_other_urls_are_refused(url, tmp_path):
    with pytest.raises(cs.InvalidArgumentError, match="is no address of an object store"):
        cs.run_batch(url, out=tmp_path, job=NamedJob())


def test_urls():
    assert split_url("s3://fleet/a b/c.bag") == ("s3://fleet", "a b/c.bag")
    assert split_url("gs://fleet/") == ("gs://fleet", "")
    assert split_url("az://fleet/x/") == ("az://fleet", "x")
    assert not is_url(Path("/tmp/s3"))
    assert not is_url("C:\\logs\\a.bag")


@pytest.mark.parametrize(
    ("pattern", "matching"),
    [
        ("logs/*.bag", {"logs/a.bag"}),
        ("logs/**/*.bag", {"logs/a.bag", "logs/x/a.bag", "logs/x/y/b.bag"}),
        ("logs/**", {"logs/a.bag", "logs/x/a.bag", "logs/x/y/b.bag", "logs/x/c.clf"}),
        ("**/[ab].bag", {"logs/a.bag", "logs/x/a.bag", "logs/x/y/b.bag"}),
        ("logs/?/*", {"logs/x/a.bag", "logs/x/c.clf"}),
        ("logs", set()),
    ],
)
def test_patterns_match_as_those_of_paths_do(pattern, matching, tmp_path):
    names = ["logs/a.bag", "logs/x/a.bag", "logs/x/y/b.bag", "logs/x/c.clf", "logs/x/.b.bag"]
    found = {name for name in names if _matches(name.split("/"), pattern.split("/"))}
    assert found == matching
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    twin = {path for path in tmp_path.glob(pattern) if path.is_file() and path.name[0] != "."}
    if sys.version_info >= (3, 13) or pattern != "logs/**":  # before, pathlib's ** is folders alone
        assert {path.relative_to(tmp_path).as_posix() for path in twin} == matching


def test_folders_of_logs_in_buckets():
    urls = ["s3://fleet/a/run.bag", "s3://fleet/b/run.bag", "s3://fleet/..", "s3://fleet/a\\b:c.bag"]
    names = name_folders(urls, {})
    assert [names[url] for url in urls[:2]] == ["run", "b-run"]
    assert names[urls[3]] == "a_b_c"
    assert all(Path(name).name == name and name not in (".", "..") for name in names.values())
    assert len({unique_name(url) for url in urls}) == 4
    assert unique_name(urls[0]).startswith("run-")


def test_a_claim_is_one_batchs_until_it_gives_it_up(bucket):
    first, second = (Claims(bucket, "claims", "options") for _ in range(2))
    assert first.take("a")
    assert not second.take("a")
    assert second.take("b")
    assert not second.confirm("a")
    first.release("a")
    assert second.take("a")
    assert not first.confirm("a")
    second.close()
    first.close()
    assert bucket.list("claims") == []


def test_a_claim_that_is_renewed_outlives_its_lease_and_another_does_not(bucket):
    alive = Claims(bucket, "claims", "options", lease=0.4)
    waiting = Claims(bucket, "claims", "options", lease=0.4)
    assert alive.take("a")
    # of another machine, so that nobody can ask whether its process lives
    lost = {"owner": "elsewhere:1:ab", "options": "options", "renewal": 1}
    bucket.write("claims/b.json", json.dumps(lost).encode())
    assert not waiting.take("b")
    deadline = time.monotonic() + 1.2
    taken = set()
    while time.monotonic() < deadline:
        taken |= {name for name in ("a", "b") if waiting.take(name)}
        time.sleep(0.05)
    assert taken == {"b"}
    assert alive.confirm("a")
    alive.close()
    waiting.close()


def test_who_stood_still_for_longer_than_the_lease_learns_that_its_claim_is_gone(bucket):
    still = Claims(bucket, "claims", "options")
    assert still.take("a")
    bucket.write("claims/a.json", b'{"owner": "elsewhere:1:ab", "options": "options"}')
    assert not still.confirm("a")
    still.close()
    assert len(bucket.list("claims")) == 1  # the other's


def test_a_claim_of_another_job_is_an_error(bucket):
    first, second = Claims(bucket, "claims", "odometry"), Claims(bucket, "claims", "slam")
    assert first.take("a")
    with pytest.raises(cs.OutputError, match="a batch with other options"):
        second.take("a")
    first.close()
    second.close()


def test_no_room_for_a_log_is_a_sentence(bucket, tmp_path, monkeypatch):
    bucket.write("logs/a.log", b"x" * 5_000_000)
    monkeypatch.setattr(worker, "Bucket", lambda address: bucket)
    monkeypatch.setattr(worker.shutil, "disk_usage", lambda path: SimpleNamespace(free=1_000_000))
    with (
        worker.scratch_folder() as scratch,
        pytest.raises(cs.StorageError, match=r"has 5 MB, and .* has room for 1 MB: set TMPDIR"),
    ):
        worker.download("s3://fleet/logs/a.log", scratch / "log")


def test_names_of_objects_lead_out_of_no_folder(bucket, tmp_path, monkeypatch):
    bucket.write("logs/bag/metadata.yaml", b"x")
    bucket.write("logs/bag/..\\..\\evil.db3", b"x")
    monkeypatch.setattr(worker, "Bucket", lambda address: bucket)
    found = worker.download("s3://fleet/logs/bag", tmp_path / "log")
    assert {path.name for path in found.iterdir()} == {"metadata.yaml", ".._.._evil.db3"}


def test_temporary_folders_of_the_dead_are_removed_and_none_is_read_by_others(tmp_path, monkeypatch):
    pytest.importorskip("fcntl", reason="no locks on folders")
    monkeypatch.setattr(worker.tempfile, "tempdir", str(tmp_path))
    (tmp_path / f"{HIDDEN_PREFIX}deaddead").mkdir()
    (tmp_path / "somebody-else").mkdir()
    with worker.scratch_folder() as one, worker.scratch_folder() as other:
        assert {path.name for path in tmp_path.iterdir()} == {one.name, other.name, "somebody-else"}
        assert one.stat().st_mode & 0o077 == 0
    assert [path.name for path in tmp_path.iterdir()] == ["somebody-else"]
