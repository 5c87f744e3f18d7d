"""output_folder and output_file: results appear together and whole, or not at all, even when the process is killed."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

from curvescan._interrupts import cleaned_up_by, held_back, note_written
from curvescan.errors import CurvescanError, OutputError
from curvescan.io.files.hidden import HIDDEN_PREFIX, hidden_folder
from curvescan.io.files.printable import printable
from curvescan.io.files.replacing import move_results
from curvescan.io.files.windows import replace

_MAX_PATH = 4_000
"""Characters of a path in a sentence."""

__all__ = ["HIDDEN_PREFIX", "output_file", "output_folder"]


@contextmanager
def output_folder(path: str | os.PathLike[str], *, inputs: Sequence[str | os.PathLike[str]] = ()) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved to `path` when the block ends without an error.

    The temporary folder is hidden, on the file system of the target and beside it (inside it where the target is a
    mount point or its parent cannot be written). It is made, and the target's access rights are tried, before the
    block runs, so that a place that cannot be written costs no work. A target that was missing appears with all its
    files in one step. In one that exists, files of the same name are replaced, and so are those of an earlier run that
    its run.json or results.json lists; other files stay. It never holds files of two runs: it changes in one step where
    nothing else is in it and the system can do that (Linux, macOS), else the old ones go before the new ones come.
    After an error the target is as before, and parent folders that were made for it are gone. A process that is killed
    leaves files of one run, and perhaps the hidden folder, which the next run into that place removes.

    Parameters
    ----------
    path : str or path-like
        Folder of the results; it and its parents are made where they are missing.
    inputs : sequence of str or path-like
        What the results are made from: stays, even where an earlier run wrote it.

    Yields
    ------
    Path
        The temporary folder, empty.

    Raises
    ------
    OutputError
        When the results cannot be written there.
    """
    with _temporary(path, _check_is_free, _hidden_for) as (temporary, target):
        yield temporary
        with held_back():
            move_results(temporary, target, [Path(source) for source in inputs])
            note_written(printable(os.fspath(path), _MAX_PATH))


@contextmanager
def output_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path; the file that the block writes there replaces `path` in one step when the block ends.

    After an error, and when the process is killed, `path` is as before. A symbolic link stays, and what it leads to
    is replaced. Missing parent folders are made.

    Raises OutputError.
    """
    with _temporary(path, _check_takes_file, _hidden_beside) as (temporary, target):
        yield temporary / target.name
        with held_back():
            replace(temporary / target.name, target)
            if not target.parent.name.startswith(HIDDEN_PREFIX):
                note_written(printable(os.fspath(path), _MAX_PATH))


@contextmanager
def _temporary(
    path: str | os.PathLike[str], check: Callable[[Path], None], hidden: Callable[[Path], AbstractContextManager[Path]]
) -> Iterator[tuple[Path, Path]]:
    """Yield a temporary folder, gone when the block ends, and the target; an error takes the new parents along."""
    made: list[Path] = []
    with cleaned_up_by(lambda: _remove(made)), _one_sentence(path):
        try:
            try:
                target = Path(os.path.realpath(path))
                check(target)
                _make_parents(target, made)
                folder = hidden(target)
                temporary = folder.__enter__()
            except ValueError as error:  # a path with a NUL character
                raise OSError(errno.EINVAL, str(error)) from error
            with ExitStack() as stack:
                stack.push(folder)
                yield temporary, target
        except BaseException:
            with held_back():
                _remove(made)
            raise


@contextmanager
def _one_sentence(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say as an OutputError why results cannot be written to `path`; a disk may also be full in the middle of a file."""
    try:
        yield
    except CurvescanError:
        raise
    except OSError as error:
        remedy = "choose another folder"
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            remedy = f"make room, or {remedy}"
        raise OutputError(
            f"cannot write results to {os.fspath(path)!r}: {error.strerror or error}; {remedy}"
        ) from error


def _check_is_free(target: Path) -> None:
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target} is a file: results need a folder, choose another name")


def _check_takes_file(target: Path) -> None:
    _check_is_free(target.parent)
    if target.exists() and not target.is_file():
        kind = "folder" if target.is_dir() else "device or a pipe"
        raise OutputError(f"{target} is a {kind}: a result needs a file, choose another name")


def _make_parents(target: Path, made: list[Path]) -> None:
    """Make the folders that are missing above the target, and list each as soon as it is made."""
    for parent in reversed([parent for parent in target.parents if not parent.exists()]):
        parent.mkdir()
        made.append(parent)


def _hidden_beside(target: Path) -> AbstractContextManager[Path]:
    return hidden_folder(target.parent)


@contextmanager
def _hidden_for(target: Path) -> Iterator[Path]:
    """Yield a hidden folder beside the target, or inside it where it must be."""
    if not target.exists():
        with hidden_folder(target.parent) as beside:
            yield beside
        return
    with ExitStack() as folders:
        # tried in any case: the results must at last go into the target itself
        with ExitStack() as trial:
            inside = trial.enter_context(hidden_folder(target))
            try:
                beside = folders.enter_context(hidden_folder(target.parent))
                is_one_system = beside.stat().st_dev == inside.stat().st_dev
            except OSError:
                is_one_system = False
            if not is_one_system:
                folders.close()
                folders.push(trial.pop_all())
                beside = inside
        yield beside


def _remove(made: list[Path]) -> None:
    for parent in reversed(made):
        try:
            parent.rmdir()
        except OSError:
            return  # no longer empty: somebody else uses it
