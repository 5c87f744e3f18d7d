"""What the commands share on the terminal: progress, tables, flags in messages, pages that are served."""

from __future__ import annotations

import os
import re
import shlex
import socket
import sys
import time
import webbrowser
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from curvescan._interrupts import stoppable
from curvescan.runs.document import ResultTable

if TYPE_CHECKING:
    from curvescan.diagnostics.issues import Issue


class _PrintableConsole(Console):
    """Prints text of others as it is, but for what would move the cursor, colour the rest or cannot be encoded."""

    def on_broken_pipe(self) -> None:
        """Go on in silence where the reader of the output (head, less) has gone; the exit status is the command's."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            text = segment.text
            if segment.control or text.isprintable() or text == "\n":
                yield segment
            else:
                plain = "".join(ch if ch.isprintable() or ch in "\n\t" else "?" for ch in text)
                yield Segment(plain, segment.style)


OUT = _PrintableConsole(
    highlight=False,
    markup=False,
    emoji=False,
    soft_wrap=True,
    width=None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120,
)
"""Results."""

ERR = _PrintableConsole(stderr=True, highlight=False, markup=False, emoji=False)
"""Progress and notices, so that results can be piped."""


class _SpeedColumn(ProgressColumn):
    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:,.0f} {self._unit}/s")


_REFRESH = 0.1  # least time between two drawings of a progress bar, seconds


@contextmanager
def progress_bar(what: str, total: int, unit: str = "scans") -> Iterator[Callable[..., None]]:
    """Yield a function to call after each unit of work; shows speed and time left on a terminal."""
    # drawn between two units of work: a thread that draws would slow what is measured by a tenth
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        _SpeedColumn(unit),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=ERR,
        auto_refresh=False,
    ) as progress:
        task = progress.add_task(what, total=total)
        progress.refresh()
        n_done, drawn = 0, time.monotonic()

        def advance(*_: object) -> None:
            nonlocal n_done, drawn
            n_done += 1
            if time.monotonic() - drawn > _REFRESH:
                progress.update(task, completed=n_done, refresh=True)
                drawn = time.monotonic()

        try:
            yield advance
        finally:
            progress.update(task, completed=n_done, refresh=True)


class RunDisplay:
    """Shows a run: a progress bar for a stage of known length, a status line for others."""

    def __init__(self, stages: ExitStack, unit: str = "scans") -> None:
        self._stages, self._unit = stages, unit
        self.advance: Callable[..., None] = lambda: None

    def begin(self, stage: str, n_steps: int) -> Callable[..., None]:
        """Begin a stage, ending the one before, and return what to call after each of its steps."""
        self._stages.close()
        if n_steps:
            self.advance = self._stages.enter_context(progress_bar(stage, n_steps, self._unit))
        else:
            self._stages.enter_context(ERR.status(stage))
        return self.advance


@contextmanager
def run_display(unit: str = "scans") -> Iterator[RunDisplay]:
    """Yield what shows the stages of :func:`curvescan.run`, or of another long run of several parts."""
    with ExitStack() as stages:
        yield RunDisplay(stages, unit)


def load_methods() -> None:
    """Load the kernels of every method."""
    from curvescan import warm_up
    from curvescan._compilation import watch
    from curvescan.matchers import MATCHERS

    with watch.held(), ERR.status("loading kernels"):
        for method in MATCHERS:
            warm_up(method, slam=False)


def show(result: ResultTable) -> None:
    """Print a table of results."""
    printed = table(result.title, *result.columns)
    for row in result.rows:
        printed.add_row(*row)
    OUT.print(printed)


def table(title: str, *columns: str) -> Table:
    """Return a table with a left column of names and right columns of figures."""
    result = Table(title=title, title_justify="left", title_style="bold")
    for k, column in enumerate(columns):
        result.add_column(column, justify="left" if k == 0 else "right")
    return result


_ARGUMENTS = (
    "as_is", "backwards", "clockwise", "drop_stale", "exports", "ignore_beams", "laser_pose", "odometry_prior", "out",
    "range_max", "reference", "relations", "timeout", "topic",
)  # fmt: skip
"""Arguments that messages name; their flags have the same names, but for those renamed."""
_RENAMED = {"exports": "export"}

_WORDS = {
    "odometry_prior=False": "--laser-only",
    "upside_down=True": "--upside-down",
    "upside_down=False": "--upright",
    "join them with Rig.of_bag": "join them with --rig",
    "read it with read_relations": "give it as --relations",
    "a smaller range_max": "a smaller --range-max",
    "SLAM with map= continues it": "`curvescan slam --map` continues it",
    "the resolution of OccupancyConfig": "--map.resolution",
}

_ARGUMENT = re.compile(rf"\b({'|'.join(_ARGUMENTS)})=('[^']*'|\([^)]*\)|[^\s,;:)]+)?")


def with_flags(message: str) -> str:
    """Return a message of the library with flags for arguments: ``--topic /scan`` for ``topic='/scan'``."""
    for words, flag in _WORDS.items():
        message = message.replace(words, flag)
    return _ARGUMENT.sub(_as_flag, message)


def _as_flag(found: re.Match[str]) -> str:
    flag = "--" + _RENAMED.get(found[1], found[1]).replace("_", "-")
    values = (found[2] or "").strip("()'").replace(",", "")
    return flag if values in ("", "True") else f"{flag} {values}"


_REVERSING = frozenset({"--backwards", "--clockwise", "--upright"})
"""Options that turn the beams round: one that was given, and is asked for all the same, is to be left out."""


def propose_commands(command: Sequence[str], issues: Sequence[Issue]) -> tuple[str, ...]:
    """Return all issues that an option handles in one sentence, with the whole command to copy; empty without any."""
    what = [issue.what for issue in issues if issue.remedy]
    return (f"{'; '.join(what)}; try: {with_options(command, issues)}",) if what else ()


def with_options(command: Sequence[str], issues: Sequence[Issue]) -> str:
    """Return a command with the options that handle issues, to copy."""
    options = {issue.what: with_flags(issue.argument) for issue in issues if issue.remedy}
    wrong = _REVERSING & set(options.values()) & set(command)
    added = [word for option in dict.fromkeys(options.values()) if option not in wrong for word in shlex.split(option)]
    return shlex.join([*(word for word in command if word not in wrong), *added])


DEFAULT_PORT = 8765  # default port of the page, unless it is in use
_POLL_S = 0.2  # time between two looks whether to close the page, seconds


def free_port(host: str, port: int | None) -> int:
    """Return the given port; else the default one, or 0, for any, where that is in use."""
    if port is not None:
        return port
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, DEFAULT_PORT))
        except OSError:
            return 0
    return DEFAULT_PORT


def open_browser(url: str) -> None:
    """Open the page where somebody sits at a desktop; a text browser would take the terminal."""
    has_desktop = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if sys.stdout.isatty() and has_desktop:
        webbrowser.open(url)


def wait(sentence: str) -> None:
    """Wait for Ctrl-C, and say so once it is waited for."""
    with stoppable() as stop:
        ERR.print(sentence)
        while not stop.is_asked:
            time.sleep(_POLL_S)
