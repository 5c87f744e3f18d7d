"""A process that is killed while it writes: each file is the old one or the new one, whole."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from curvescan.io import read_log, read_tum

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")

N_KILLS = 20

WRITER = """
import os
import random
import signal
import sys
import time
import numpy as np
from curvescan.io import log_from_arrays, output_folder, write_log, write_tum
from curvescan.io.trajectories.relations import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory

folder, rng = sys.argv[1], random.Random(11)


# the number of the round is in every value, so that a file of two rounds would show
logs = [
    log_from_arrays(
        [(i, np.full(360, 1.0 + k)) for i in range(100)], angle_min=0.0, angle_increment=0.0078125
    )
    for k in range(3)
]


at_work, tell = os.pipe()


def write(k):
    log = logs[k % 3]
    for name in ("a.csv", "a.clf", "a.npz", "a.bag", "a.mcap"):
        os.write(tell, b".")
        write_log(f"{folder}/{name}", log)
    trajectory = Trajectory(stamps=np.arange(200.0), poses=np.full((200, 3), float(k % 3)))
    os.write(tell, b".")
    write_tum(f"{folder}/a.tum", trajectory)
    write_g2o(f"{folder}/a.g2o", trajectory, [])
    os.write(tell, b".")
    with output_folder(f"{folder}/results") as results:
        (results / f"new-{k}").mkdir()
        for name in ("x", f"new-{k}/x", f"new-{k}/y"):
            (results / name).write_text(f"{k}\\n" * 2000)
    os.write(tell, b".")
    write_log(f"{folder}/bag-{k}", log, format="ros2")


write(0)
k = 1
while sys.stdin.readline():
    os.write(tell, b".")
    os.read(at_work, 1_000_000)  # what the last one told
    child = os.fork()  # starting anew would take longer than what is looked at
    if child == 0:
        while True:
            write(k)
            k += 1
    # by the work done, not by the clock, which runs on while other processes have the processor
    for _ in range(rng.randint(2, 10)):
        os.read(at_work, 1)
    time.sleep(rng.uniform(0.0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    k += 1000
    print("killed", flush=True)
"""


def check(folder: Path) -> int:
    """Check all that is there, and return how many files that is."""
    n_files = 0
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue  # what the killed process was working in
        n_files += 1
        if path.suffix == ".tum":
            assert len(read_tum(path)) == 200
            assert len(np.unique(read_tum(path).poses[:, :2])) == 1
        elif path.suffix == ".g2o":
            lines = path.read_text().splitlines()
            assert (len(lines), lines[-1]) == (201, "FIX 0")
        elif path.name == "results":
            for entry in path.rglob("*"):
                is_hidden = any(part.startswith(".") for part in entry.relative_to(path).parts)
                if entry.is_file() and not is_hidden:  # what the killed process was working in
                    lines = entry.read_text().splitlines()
                    assert (len(lines), len({*lines})) == (2000, 1)
            for new in path.glob("new-*"):
                assert sorted(entry.name for entry in new.iterdir()) == ["x", "y"]
        else:
            log = read_log(path)
            assert (len(log), log.read_errors) == (100, ())
            assert len({value for scan in log for value in scan.ranges}) == 1
            assert path.is_file() or (path / "metadata.yaml").is_file()
    return n_files


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path: Path) -> None:
    n_interrupted = 0
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for _ in range(N_KILLS):
            process.stdin.write("go\n")
            process.stdin.flush()
            assert process.stdout.readline() == "killed\n"
            assert check(tmp_path) >= 9
            n_interrupted += clean(tmp_path)
        process.stdin.close()
    # else the kills would have missed what they are for
    assert n_interrupted > N_KILLS // 2


def clean(folder: Path) -> bool:
    """Remove what has been looked at, and return whether the killed process was at work on a file."""
    left = [*folder.glob(".curvescan-*"), *folder.glob("results/.curvescan-*")]
    for path in [*left, *folder.glob("bag-*[1-9]"), *folder.glob("results/new-*")]:
        shutil.rmtree(path)
    return bool(left)
