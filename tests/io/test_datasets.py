"""Public files are downloaded once, checked, unpacked and kept; what goes wrong is one sentence."""

from __future__ import annotations

import bz2
import dataclasses
import functools
import gzip
import hashlib
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pooch
import pytest

import curvescan as cs
from curvescan import datasets
from curvescan.cli.main import run
from curvescan.errors import InvalidArgumentError, SourceError

LOG = b"# CARMEN Logfile\n" + b"FLASER 3 1.0 1.0 1.0 0 0 0 0 0 0 1.0 host 1.0\n" * 3


class Handler(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def server(tmp_path, monkeypatch):
    """A server of two files, plain and compressed, which stand in the table; yields its folder and the cache."""
    folder, cache = tmp_path / "served", tmp_path / "cache"
    folder.mkdir()
    monkeypatch.setenv("CURVESCAN_DATASETS", str(cache))
    for name in ("plain.log", "packed.log.bz2"):
        (folder / name).write_bytes(bz2.compress(LOG) if name.endswith("bz2") else LOG)
        row = dataclasses.replace(
            datasets.DATASETS["intel"], path=name, n_bytes=len(LOG), sha256=hashlib.sha256(LOG).hexdigest()
        )
        monkeypatch.setitem(datasets.DATASETS, name.partition(".")[0], row)
    http = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=folder))
    thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    monkeypatch.setattr(datasets, "_HOST", f"http://127.0.0.1:{http.server_port}")
    yield folder, cache
    http.shutdown()
    http.server_close()
    thread.join()


@pytest.mark.parametrize("name", ["plain", "packed"])
def test_a_file_is_downloaded_once_and_its_licence_said_once(server, name, caplog, monkeypatch):
    folder, cache = server
    monkeypatch.setattr(pooch.get_logger(), "handlers", [caplog.handler])  # it does not propagate
    path = datasets.fetch(name)
    assert path == cache / f"{name}.log"
    assert path.read_bytes() == LOG
    assert caplog.text.count("Licence: CC BY") == 1
    assert caplog.text.count("Please cite: ") == 1
    for served in folder.iterdir():
        served.unlink()
    assert datasets.fetch(name) == path
    assert caplog.text.count("Licence: ") == 1


def test_a_damaged_file_is_downloaded_anew(server):
    path = datasets.fetch("packed")
    path.write_bytes(LOG[:-1])
    assert datasets.fetch("packed").read_bytes() == LOG


@pytest.mark.parametrize(
    "content", [LOG + b"!", LOG[:20], b"", bz2.compress(LOG)[:-40], b"no bz2", bz2.compress(bytes(10**6))]
)
@pytest.mark.parametrize("name", ["plain.log", "packed.log.bz2"])
def test_another_content_is_refused_and_not_kept(server, name, content):
    folder, cache = server
    (folder / name).write_bytes(content)
    with pytest.raises(
        SourceError, match=r"cannot download \w+ from http\S+: the content is not the one whose SHA-256"
    ):
        datasets.fetch(name.partition(".")[0])
    assert not list(cache.iterdir())


def test_a_server_without_the_file_and_no_server_are_one_sentence(server, monkeypatch):
    folder, cache = server
    (folder / "plain.log").unlink()
    with pytest.raises(SourceError, match="the server answers 404 File not found; try again later, or save") as caught:
        datasets.fetch("plain")
    assert str(cache / "plain.log") in str(caught.value)
    monkeypatch.setattr(datasets, "_HOST", "http://127.0.0.1:9")
    with pytest.raises(
        SourceError, match=r"from http://127.0.0.1:9/plain.log: no connection; try again later"
    ) as caught:
        datasets.fetch("plain")
    assert "\n" not in str(caught.value)


def test_a_cache_that_cannot_be_written_is_one_sentence(server, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CURVESCAN_DATASETS", str(tmp_path / "file" / "cache"))
    with pytest.raises(SourceError, match=r"cannot download plain .*Not a directory"):
        datasets.fetch("plain")


def test_an_unknown_name_is_met_with_the_nearest():
    with pytest.raises(InvalidArgumentError, match="unknown data set 'intle': did you mean 'intel'"):
        datasets.fetch("intle")
    assert run(["demo", "--log", "intle"]) == 1


@pytest.mark.parametrize("name", datasets.DATASETS)
def test_a_row_says_what_to_cite_and_can_be_checked(name):
    row = datasets.DATASETS[name]
    assert len(bytes.fromhex(row.sha256)) == 32
    assert row.n_bytes > 0
    assert row.path.count("/") > 2
    assert all((row.about, row.licence, row.citation))


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("intel", "intel-lab/intel.clf.gz"),
        ("intel.relations", "intel-lab/intel.relations"),
        ("kitchen", "mumble-rplidar-a1/kitchen_1/my_data_bag_0.db3.gz"),
        ("hallway", "mumble-rplidar-a1/slow_half_hallway/my_data_bag_0.db3.gz"),
        ("pedestrians", "leg-tracker-people/demo_stationary_simple_environment.bag.gz"),
    ],
)
def test_size_and_digest_are_those_of_the_real_file(real_data, name, file):
    content = (real_data / file).read_bytes()
    content = gzip.decompress(content) if file.endswith(".gz") else content
    assert len(content) == datasets.DATASETS[name].n_bytes
    assert hashlib.sha256(content).hexdigest() == datasets.DATASETS[name].sha256


@pytest.mark.slow  # a run
def test_the_demo_maps_a_public_log_and_measures_it(server, tmp_path, monkeypatch, capsys):
    folder, _ = server
    log = cs.simulate(n_scans=30)
    for name, content in (("short", _written(log, tmp_path)), ("short.relations", _relations(log))):
        (folder / name).write_bytes(content)
        row = dataclasses.replace(
            datasets.DATASETS["intel"], path=name, n_bytes=len(content), sha256=hashlib.sha256(content).hexdigest()
        )
        monkeypatch.setitem(datasets.DATASETS, name, row)
    out = tmp_path / "out"
    assert run(["demo", "--log", "short", "--out", str(out)]) in (0, 3)
    assert len((out / "trajectory.tum").read_text().splitlines()) == 30
    assert "relations" in capsys.readouterr().out


def _written(log, folder):
    cs.write_log(folder / "short.csv", log)
    return (folder / "short.csv").read_bytes()


def _relations(log):
    """The true motion between every tenth scan, as lines of the benchmark."""
    stamps, poses = [scan.stamp for scan in log][::10], log.truth.poses[::10]
    motions = cs.se2.between(poses[:-1], poses[1:])
    rows = zip(stamps[:-1], stamps[1:], motions.tolist(), strict=True)
    return "".join(f"{a!r} {b!r} {x!r} {y!r} 0 0 0 {th!r}\n" for a, b, (x, y, th) in rows).encode()
