"""The campaign of hostile files: ``python -m tests.fuzz READER [--minutes N] [--seed K] [--out FOLDER]``.

Readers are tried one after the other, each in a process of its own whose address space is limited. A file that breaks a
promise (see fuzzing.py) is kept with the traceback in its name's ``.txt``; so is one on which the process hangs or
dies. The number of files tried is printed for each reader.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from tests.fuzzing import Finding, check, targets

MAX_SECONDS = 5
MAX_GROWTH = 256 << 20
"""How far the address space may grow beyond that after the sound files, bytes."""

_MAX_FINDINGS = 20


class _Hang(BaseException):
    """A reader takes too long; no Exception, for readers may catch those."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Try readers and return the number of findings."""
    with tempfile.TemporaryDirectory() as seeds:
        names = list(targets(Path(seeds)))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("readers", nargs="*", metavar="READER", default=names, help=", ".join(names))
    parser.add_argument("--minutes", type=float, default=1.0, help="for each reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("findings"), help="folder for what is found")
    options = parser.parse_args(arguments)
    n_findings = 0
    for name in options.readers:
        n_files, n_found = _supervise(name, options.minutes * 60.0, options.seed, options.out)
        n_findings += n_found
        print(f"{name}: {n_files:,} files, {n_found} findings", flush=True)
    return n_findings


def _supervise(name: str, seconds: float, seed: int, out: Path) -> tuple[int, int]:
    """Run the process of a reader, anew where it hangs or dies, and return the numbers of files and findings."""
    n_files = n_found = 0
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(dir=_fast_folder()) as folder:
        while (left := end - time.monotonic()) > 0.0 and n_found < _MAX_FINDINGS:
            counts = multiprocessing.Value("q", 0), multiprocessing.Value("q", 0)
            what = name, left, seed + n_files, Path(folder), out, *counts
            process = multiprocessing.get_context("fork").Process(target=_campaign, args=what)
            process.start()
            is_hanging = _watch(process, counts[0])
            n_files, n_found = n_files + counts[0].value, n_found + counts[1].value
            if is_hanging or process.exitcode:
                n_found += 1
                text = "hangs" if is_hanging else f"dies with {process.exitcode}"
                _keep(out, f"{name}-{seed}-{n_files}", (Path(folder) / "file").read_bytes(), text)
    return n_files, n_found


def _watch(process: multiprocessing.process.BaseProcess, count: Synchronized[int]) -> bool:
    """Wait for the end of a process and return whether it stood still and had to be ended."""
    last = -1
    while process.is_alive():
        process.join(10 * MAX_SECONDS)
        if process.is_alive() and count.value == last:
            process.kill()
            process.join()
            return True
        last = count.value
    return False


def _campaign(
    name: str,
    seconds: float,
    seed: int,
    folder: Path,
    out: Path,
    n_files: Synchronized[int],
    n_found: Synchronized[int],
) -> None:
    warnings.simplefilter("error")
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as seeds:
        target = targets(Path(seeds))[name]()
    path = folder / "file"
    for data in target.seeds:
        check(target, path, data, random.Random(0))
    used = _address_space()
    resource.setrlimit(resource.RLIMIT_AS, (used + 8 * MAX_GROWTH,) * 2)
    signal.signal(signal.SIGALRM, _alarm)
    kinds: set[str] = set()
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(kinds) < _MAX_FINDINGS:
        data = target.hostile(rng)
        n_files.value += 1
        signal.setitimer(signal.ITIMER_REAL, MAX_SECONDS)
        try:
            check(target, path, data, rng)
            peak = _address_space()
            if peak > used + MAX_GROWTH:
                used = peak
                raise Finding(f"address space grew to {peak:,} bytes")
        except (Exception, _Hang) as error:  # noqa: BLE001 - that is what is looked for
            signal.setitimer(signal.ITIMER_REAL, 0)
            kind = _kind(error)
            if kind not in kinds:
                kinds.add(kind)
                n_found.value += 1
                _keep(out, f"{name}-{seed}-{n_files.value}", data, traceback.format_exc())
        signal.setitimer(signal.ITIMER_REAL, 0)


def _kind(error: BaseException) -> str:
    """Return what tells one finding from another: the class of the error and where it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    return f"{type(error).__name__} {[(f.filename, f.lineno) for f in frames[-2:]]}"


def _alarm(*_: object) -> None:
    raise _Hang(f"more than {MAX_SECONDS} s")


def _address_space() -> int:
    """Return the peak of the address space so far, bytes."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmPeak:")[2].split()[0])


def _keep(out: Path, name: str, data: bytes, text: str) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (out / name).write_bytes(data)
    (out / f"{name}.txt").write_text(text)


def _fast_folder() -> Path | None:
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else None


if __name__ == "__main__":
    sys.exit(main() > 0)
