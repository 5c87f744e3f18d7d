"""run_batch: many logs, worker processes that die, hang and are left alone, and what is kept of it all."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace

import pytest

import curvescan as cs
from curvescan.cli.main import run as command
from curvescan.runs.batch.jobs import digest_of
from curvescan.runs.batch.logs import find_logs, name_folders
from curvescan.runs.batch.places import open_results
from curvescan.runs.batch.results import BatchRecord, parse_record, read_manifest, record_line
from tests.conftest import ROOT
from tests.runs.batch.batch_jobs import LargeJob, NamedJob, UnloadableJob


def make_logs(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_text("x" * 10)
    return folder / "*"


def by_name(result):
    return {record.input.rpartition("/")[2]: record for record in result.records}


def loaded_by(words):
    """Packages that a fresh process has loaded when the command has ended."""
    code = (
        "import sys; from curvescan.cli.main import run; assert run(sys.argv[1:]) == 0;"
        "print(*{name.partition('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # a process that has ended and that nobody waits for is still listed
    with open(f"/proc/{pid}/stat") as file:  # noqa: PTH123
        return file.read().rpartition(")")[2].split()[0] != "Z"


def test_one_bad_log_stops_no_other(tmp_path):
    names = ["a.log", "b-kill.log", "c-hang.log", "d-raise.log", "e-exit.log", "f-print.log"]
    logs = make_logs(tmp_path / "logs", *names, "g-odd.log", "h.log")
    result = cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), workers=2, timeout=1.5)
    records = by_name(result)
    assert [r.exit for r in result.records] == [0, 1, 1, 1, 1, 0, 3, 0]
    assert records["b-kill.log"].sentence == ("its worker process was ended by SIGKILL: out of memory?")
    assert "stopped after 1.5 s" in records["c-hang.log"].sentence
    assert 1.5 <= records["c-hang.log"].seconds < 10.0
    assert records["d-raise.log"].sentence.startswith("RuntimeError: of no known kind")
    assert "exit status 7" in records["e-exit.log"].sentence
    assert records["g-odd.log"].sentence == "not to be trusted: odd"
    assert records["g-odd.log"].verdict == "not trusted"
    workers_log = (tmp_path / "out" / "workers.log").read_text()
    assert "of no known kind" in workers_log
    assert "not a reply" in workers_log
    assert result.n_failed == 4
    assert repr(result) == "BatchResult(8 logs: 3 trusted, 4 failed)"
    with (tmp_path / "out" / "fleet.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [r.verdict for r in result.records]
    assert rows[0]["scans"] == "10"
    for record in result.records:
        assert (tmp_path / "out" / record.folder).exists() == (not record.is_failed)


def test_the_table_holds_all_that_the_folder_does(tmp_path):
    for day in ("monday", "tuesday"):
        logs = make_logs(tmp_path / day, "a.log", "b-raise.log")
        cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), workers=1)
    with (tmp_path / "out" / "fleet.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["input"].rpartition("day/")[2] for row in rows] == ["a.log", "b-raise.log"] * 2
    assert [row["verdict"] for row in rows] == ["trusted", "failed"] * 2


def test_workers_live_longer_than_a_log(tmp_path):
    logs = make_logs(tmp_path / "logs", *(f"{k}.log" for k in range(12)))
    result = cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), workers=2)
    pids = {(tmp_path / "out" / r.folder / "result").read_text().split()[1] for r in result.records}
    assert 1 <= len(pids) <= 2
    assert str(os.getpid()) not in pids
    assert not any(is_alive(int(pid)) for pid in pids)


def test_resume_runs_only_what_does_not_stand(tmp_path):
    logs, out = make_logs(tmp_path / "logs", "a.log", "b.log", "c-raise.log"), tmp_path / "out"

    def run_again(job, resume=True):
        before = {r: r.stat().st_mtime_ns for r in out.glob("*/result")}
        result = cs.run_batch(logs, out=out, job=job, workers=1, resume=resume)
        changed = [r for r in out.glob("*/result") if before.get(r) != r.stat().st_mtime_ns]
        return result, {path.parent.name for path in changed}

    assert run_again(NamedJob())[1] == {"a", "b"}
    (tmp_path / "logs" / "c-raise.log").unlink()
    started = time.perf_counter()
    result, changed = run_again(NamedJob())
    assert time.perf_counter() - started < 1.0
    assert (changed, result.n_skipped, result.n_failed) == (set(), 2, 0)
    (tmp_path / "logs" / "a.log").write_text("longer than before")
    assert run_again(NamedJob())[1] == {"a"}
    os.utime(tmp_path / "logs" / "b.log", (1, 1))
    assert run_again(NamedJob())[1] == {"b"}
    assert run_again(NamedJob(option=1))[1] == {"a", "b"}
    assert run_again(NamedJob(option=1), resume=False)[1] == {"a", "b"}
    (out / "a" / "result").unlink()
    (out / "a").rmdir()
    assert run_again(NamedJob(option=1))[1] == {"a"}


def test_what_failed_is_run_again(tmp_path):
    logs, out = make_logs(tmp_path / "logs", "a.log", "b-raise.log"), tmp_path / "out"
    cs.run_batch(logs, out=out, job=NamedJob(), workers=1)
    assert cs.run_batch(logs, out=out, job=NamedJob(), workers=1, resume=True).n_skipped == 1


def test_results_are_on_the_disk_before_the_record_that_lists_them(tmp_path, monkeypatch):
    synced, fsync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda n: (synced.append(os.fstat(n).st_ino), fsync(n)))
    logs, out = make_logs(tmp_path / "logs", "a.log"), tmp_path / "out"
    cs.run_batch(logs, out=out, job=NamedJob(), workers=1)
    places = (out / "a" / "result", out / "a", out, out / "manifest.jsonl")
    order = [synced.index(place.stat().st_ino) for place in places]
    assert order == sorted(order)


_SUPERVISOR = """
import signal

import curvescan as cs

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
from tests.runs.batch.batch_jobs import NamedJob
cs.run_batch({logs!r}, out={out!r}, job=NamedJob(), workers=2)
"""


def start_supervisor(tmp_path, **options):
    """Start a batch in another process, and return it once some of its logs are done."""
    logs = make_logs(tmp_path / "logs", *(f"{k}-slow.log" for k in range(12)))
    code = _SUPERVISOR.format(logs=str(logs), out=str(tmp_path / "out"))
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    supervisor = subprocess.Popen([sys.executable, "-c", code], env=env, cwd=ROOT, **options)
    manifest = tmp_path / "out" / "manifest.jsonl"
    for _ in range(200):
        if manifest.exists() and len(read_manifest(manifest)) >= 3:
            return logs, supervisor
        time.sleep(0.05)
    supervisor.kill()
    raise AssertionError("the batch has not begun")


def test_a_killed_supervisor_leaves_no_workers_and_is_resumed(tmp_path):
    logs, supervisor = start_supervisor(tmp_path)
    with pytest.raises(cs.OutputError, match="another batch writes to"):
        cs.run_batch(logs, out=tmp_path / "out", job=NamedJob())
    supervisor.send_signal(signal.SIGKILL)
    supervisor.wait()
    manifest = tmp_path / "out" / "manifest.jsonl"
    done = read_manifest(manifest)
    pids = {int(p.read_text().split()[1]) for p in (tmp_path / "out").glob("*/result")}
    deadline = time.monotonic() + 3.0
    while any(is_alive(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(is_alive(pid) for pid in pids)
    # as if it had been killed while it wrote a line, and a worker while it wrote results
    with manifest.open("a") as file:
        file.write('{"input": "/a.lo')
    (tmp_path / "out" / ".curvescan-left").mkdir()
    result = cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), workers=2, resume=True)
    assert result.n_skipped == len(done)
    assert 3 <= len(done) < 12
    assert [r.exit for r in result.records] == [0] * 12
    assert len(read_manifest(manifest)) == 12
    assert not (tmp_path / "out" / ".curvescan-left").exists()


def children_of(pid):
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    return [int(word) for word in found.stdout.split()]


def test_ctrl_c_ends_the_workers_and_keeps_what_is_done(tmp_path):
    logs, supervisor = start_supervisor(tmp_path, start_new_session=True, stderr=subprocess.DEVNULL)
    workers = children_of(supervisor.pid)
    os.killpg(supervisor.pid, signal.SIGINT)  # as a terminal does: to all processes at once
    assert supervisor.wait(timeout=10) != 0
    assert len(workers) == 2
    assert not any(map(is_alive, workers))
    result = cs.run_batch(logs, out=tmp_path / "out", job=NamedJob(), workers=2, resume=True)
    assert 3 <= result.n_skipped < 12
    assert [r.exit for r in result.records] == [0] * 12
    assert not (tmp_path / "out" / "workers.log").exists()  # nothing was said


def test_sigterm_ends_the_command_with_a_sentence(tmp_path):
    make_logs(tmp_path / "logs", "0.npz")
    cs.write_log(tmp_path / "logs" / "0.npz", cs.simulate("office", n_scans=6, seed=1))
    for k in range(1, 30):
        shutil.copy(tmp_path / "logs" / "0.npz", tmp_path / "logs" / f"{k}.npz")
    words = ["batch", str(tmp_path / "logs" / "*"), "--out", str(tmp_path / "out")]
    batch = subprocess.Popen(
        [sys.executable, "-m", "curvescan", *words, "--workers", "2"], stderr=subprocess.PIPE, text=True
    )
    workers = []
    deadline = time.monotonic() + 240.0  # it may have to compile first
    while time.monotonic() < deadline and len(workers) < 2:
        time.sleep(0.05)
        if (tmp_path / "out" / "workers.log").exists():
            workers = children_of(batch.pid)
    batch.terminate()
    _, said = batch.communicate(timeout=10)
    assert batch.returncode == 143
    assert "interrupted: the logs listed in" in said
    assert "Traceback" not in said
    assert len(workers) >= 2  # and in a first run the process that helps to compile
    assert not any(map(is_alive, workers))
    assert len(read_manifest(tmp_path / "out" / "manifest.jsonl")) < 30


def test_logs_of_one_name_get_folders_of_their_own(tmp_path):
    for floor in ("first", "second"):
        make_logs(tmp_path / "logs" / floor, "office.clf.gz", "Office.bag")
    pattern = tmp_path / "logs" / "**" / "*"
    result = cs.run_batch(pattern, out=tmp_path / "out", job=NamedJob(), workers=1)
    names = [record.folder for record in result.records]
    assert names == ["Office", "first-office", "second-Office", "second-office-logs"][:1] + names[1:]
    assert len({name.casefold() for name in names}) == 4
    for record in result.records:
        assert (tmp_path / "out" / record.folder / "result").read_text().startswith(record.input)
    # a folder stays that of its log when others come
    make_logs(tmp_path / "logs" / "a", "office.clf.gz")
    again = cs.run_batch(pattern, out=tmp_path / "out", job=NamedJob(), workers=1, resume=True)
    assert again.n_skipped == 4
    assert {r.input: r.folder for r in result.records}.items() <= {r.input: r.folder for r in again.records}.items()


def test_folders_are_named_after_logs_and_never_after_files_of_the_batch(tmp_path):
    paths = [tmp_path / n for n in ("intel.clf.gz", "v1.2 run.bag", ".hidden", "fleet.csv.npz")]
    names = name_folders([*map(str, paths)], {}, ("manifest.jsonl", "fleet.csv"))
    assert [names[str(p)] for p in paths[:2]] == ["intel", "v1.2 run"]
    assert not names[str(paths[2])].startswith(".")
    assert names[str(paths[3])] == f"{tmp_path.name}-fleet.csv"


def test_patterns_find_files_and_bag_folders(tmp_path):
    make_logs(tmp_path / "a", "x.log", "y.log")
    make_logs(tmp_path / "a" / "deep", "z.log")
    bag = tmp_path / "a" / "bag"
    make_logs(bag, "metadata.yaml")
    (bag / "bag_0.db3").write_bytes(b"SQLite format 3\x00")
    make_logs(tmp_path / "[1]", "x.log")
    found = find_logs([tmp_path / "a" / "**", tmp_path / "a" / "x.log"])
    assert [os.path.relpath(state.input, tmp_path) for state in found] == [
        "a/bag",
        "a/deep/z.log",
        "a/x.log",
        "a/y.log",
    ]
    (one,) = find_logs([tmp_path / "[1]" / "x.log"])
    assert one.input == str(tmp_path / "[1]" / "x.log")
    with pytest.raises(cs.InvalidArgumentError, match="no log matches"):
        find_logs([tmp_path / "a" / "*.mcap"])


def test_a_manifest_names_no_folder_outside_the_batch(tmp_path):
    record = {
        "input": "/a.log", "bytes": 1, "mtime_ns": 1, "options": "", "version": "", "exit": 0,
        "verdict": "", "sentence": "", "seconds": 1.0, "scans": 1, "metres": 0.0,
    }  # fmt: skip
    lines = [record | {"folder": folder} for folder in ("../b", "/etc", "a")]
    path = tmp_path / "manifest.jsonl"
    path.write_text("\n".join([*map(json.dumps, lines[:2]), "[1]", "null", '{"input": 3}']))
    assert read_manifest(path) == {}
    path.write_text(json.dumps(lines[2]) + "\n")
    assert read_manifest(path)["/a.log"].folder == "a"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full disk")  # noqa: PTH110
def test_a_full_disk_ends_the_batch_in_a_sentence(tmp_path):
    logs = make_logs(tmp_path / "logs", "a.log", "b.log")
    with open_results(tmp_path / "out") as results, open("/dev/full", "ab", buffering=0) as full:  # noqa: PTH123
        result = cs.run_batch(logs, out=tmp_path / "other", job=NamedJob(), workers=1)
        results._manifest = full
        with pytest.raises(cs.OutputError, match="No space left on device"):
            results.append(result.records[0])
    assert results.records == {}


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 640 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=640k", "tmpfs", str(place)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_log_that_fills_the_disk_fails_and_is_run_when_there_is_room(small_disk, tmp_path):
    logs = make_logs(tmp_path / "logs", "a.log", "b.log", "c.log")
    result = cs.run_batch(logs, out=small_disk / "out", job=LargeJob(), workers=1)
    assert [record.exit for record in result.records] == [0, 0, 1]
    assert "No space left on device" in result.records[2].sentence
    subprocess.run(["mount", "-o", "remount,size=4M", str(small_disk)], check=True)
    again = cs.run_batch(logs, out=small_disk / "out", job=LargeJob(), workers=1, resume=True)
    assert again.n_skipped == 2
    assert [record.exit for record in again.records] == [0, 0, 0]


def test_workers_that_cannot_begin_end_the_batch(tmp_path):
    logs = make_logs(tmp_path / "logs", "a.log")
    with pytest.raises(cs.WorkerError, match="ImportError: this machine lacks a part of it"):
        cs.run_batch(logs, out=tmp_path / "out", job=UnloadableJob(), workers=1)


def test_a_job_that_workers_cannot_load_is_refused(tmp_path):
    @dataclass(frozen=True)
    class LocalJob(NamedJob):
        pass

    logs = make_logs(tmp_path / "logs", "a.log")
    with pytest.raises(cs.InvalidArgumentError, match="a dataclass that a module defines"):
        cs.run_batch(logs, out=tmp_path / "out", job=LocalJob())


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"workers": 0}, "workers must be at least 1"),
        ({"timeout": 0.0}, "timeout must be a positive number"),
        ({"timeout": float("nan")}, "timeout must be a positive number"),
    ],
)
def test_arguments_out_of_range(arguments, rule, tmp_path):
    with pytest.raises(cs.InvalidArgumentError, match=rule):
        cs.run_batch(make_logs(tmp_path / "logs", "a.log"), out=tmp_path / "out", **arguments)


def test_the_digest_is_of_the_options_alone():
    job = cs.OdometryJob(command=("curvescan", "batch"))
    assert digest_of(job) == digest_of(cs.OdometryJob())
    others = [cs.OdometryJob(method="plicp"), cs.OdometryJob(odometry_prior=True), cs.SlamJob()]
    others.append(cs.OdometryJob(config=cs.OdometryConfig.scan_to_scan()))
    assert len({digest_of(job), *map(digest_of, others)}) == 5


def test_what_is_left_to_the_defaults_is_filled_in():
    given = {"config": cs.OdometryConfig(), "matcher": cs.CurvescanConfig()}
    assert digest_of(cs.OdometryJob(**given)) == digest_of(cs.OdometryJob())
    assert digest_of(cs.SlamJob(config=cs.SlamConfig())) == digest_of(cs.SlamJob())
    wide = {"keyframes": {"distance": 2.0}}
    assert cs.OdometryJob(config=wide).config.keyframes.distance == 2.0
    assert digest_of(cs.OdometryJob(config=wide)) != digest_of(cs.OdometryJob())
    assert cs.OdometryJob(method="plicp").config == cs.OdometryConfig.scan_to_scan()
    with pytest.raises(cs.InvalidArgumentError, match="unknown method 'plcp': did you mean 'plicp'"):
        cs.OdometryJob(method="plcp")
    with pytest.raises(cs.InvalidArgumentError, match=r"matcher must be a PlIcpConfig"):
        cs.OdometryJob(method="plicp", matcher=cs.CurvescanConfig())
    with pytest.raises(cs.InvalidArgumentError, match="unknown key 'keyframe'"):
        cs.SlamJob(config={"keyframe": {}})


@pytest.mark.slow
@pytest.mark.parametrize("flags", [(), ("--slam",)])
def test_the_command_writes_what_one_command_a_log_writes(flags, tmp_path, capsys):
    log = tmp_path / "office.npz"
    cs.write_log(log, cs.simulate("office", n_scans=6, seed=1))
    (tmp_path / "broken.npz").write_bytes(log.read_bytes()[:400])
    words = ["batch", str(tmp_path / "*.npz"), "--out", str(tmp_path / "out"), *flags]
    assert command(words) == 1
    printed = capsys.readouterr()
    assert "2 logs: 1 trusted, 0 not to be trusted, 1 failed" in printed.out
    assert f"{tmp_path}/broken.npz: " in printed.err
    assert command(["slam" if flags else "odometry", str(log), "--out", str(tmp_path / "one")]) == 0
    alone, batch = tmp_path / "one", tmp_path / "out" / "office"
    assert {path.name for path in batch.iterdir()} == {path.name for path in alone.iterdir()}
    for name in ("trajectory.tum", "trajectory.csv", "map.pgm"):
        assert (batch / name).read_bytes() == (alone / name).read_bytes()
    (tmp_path / "broken.npz").unlink()
    capsys.readouterr()
    assert command([*words, "--resume"]) == 0
    assert "1 log (1 stood from before): 1 trusted" in capsys.readouterr().out
    assert not loaded_by([*words, "--resume"]) & {"numba", "scipy", "matplotlib"}
    # the same options have one digest, from the command and from Python
    job = cs.SlamJob() if flags else None
    assert cs.run_batch(words[1], out=tmp_path / "out", job=job, resume=True).n_skipped == 1


@pytest.mark.parametrize("folder", ["..", "", "a/b"])
def test_a_manifest_does_not_lead_out_of_its_folder(folder):
    known = {"input": "a.clf", "bytes": 1, "mtime_ns": 2, "options": "", "version": "", "exit": 0, "seconds": 1.0}
    record = BatchRecord(**known, verdict="trusted", sentence="", folder="a")
    assert parse_record(record_line(record)) == record
    assert parse_record(record_line(replace(record, folder=folder))) is None
    assert parse_record(b"[" * 100_000) is None
