"""Ctrl-C and SIGTERM: held back where work must not be cut in two, and otherwise the end of a command, at once.

An exception that a signal raises can appear between any two instructions, in the middle of a clean-up too.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from types import FrameType
from typing import Any, TypeAlias, TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM)
NOTHING_WRITTEN = "interrupted, nothing written"

CleanUp: TypeAlias = Callable[[], object]
_T = TypeVar("_T")

_clean_ups: list[CleanUp] = []
_sentences: list[str] = [NOTHING_WRITTEN]


class Stop:
    """Whether a loop is to stop."""

    def __init__(self) -> None:
        self.is_asked = False


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Yield what says whether Ctrl-C (or SIGTERM, where a handler is set) asks the loop inside to stop.

    The first signal only asks; a second one raises KeyboardInterrupt, which ends at this place, for a loop that waits
    for something that does not come. In threads other than the main one, which signals do not reach, nothing ever asks.
    """
    stop = Stop()

    def ask(_number: int, _frame: FrameType | None) -> None:
        if stop.is_asked:
            raise KeyboardInterrupt
        stop.is_asked = True

    with _handled_by(ask):
        try:
            yield stop
        except KeyboardInterrupt:
            stop.is_asked = True


@contextmanager
def held_back() -> Iterator[None]:
    """Do what is inside as a whole: signals that arrive meanwhile take effect at its end."""
    received: list[int] = []
    with _handled_by(lambda number, _frame: received.append(number)):
        yield
    if received:
        handler = signal.getsignal(received[0])
        if callable(handler):
            handler(received[0], None)


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    usual: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                # one that is ignored (a job in the background) or ends the process stays as it is
                was = signal.getsignal(number)
                if callable(was):
                    usual[number] = was
                    signal.signal(number, handler)
        yield
    finally:
        for each, handler_before in usual.items():
            signal.signal(each, handler_before)


def cleaned_up_by(clean_up: CleanUp) -> AbstractContextManager[None]:
    """Have a function called before the process is ended at once by a signal inside; it must not raise or take long."""
    return _among(_clean_ups, clean_up)


def reported_as(sentence: str) -> AbstractContextManager[None]:
    """Have a signal that arrives inside reported by this sentence."""
    return _among(_sentences, sentence)


@contextmanager
def _among(items: list[_T], item: _T) -> Iterator[None]:
    items.append(item)
    try:
        yield
    finally:
        items.remove(item)


def note_written(what: str) -> None:
    """Report later signals as coming after results were written, unless the work in hand says otherwise."""
    _sentences[0] = f"interrupted; the results in {what} are written"


def end_commands_at_once() -> None:
    """Let Ctrl-C and SIGTERM end this process by :func:`end_at_once`, unless its parent had it ignore them."""
    usual = (signal.default_int_handler, signal.SIG_DFL)
    for each in SIGNALS:
        if signal.getsignal(each) in usual:
            signal.signal(each, end_at_once)


def end_at_once(number: int, frame: FrameType | None = None) -> None:
    """Clean up, say a sentence on stderr and end the process with the status that shells give a signal (130, 143)."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    for clean_up in reversed(_clean_ups):
        with suppress(Exception):
            clean_up()
    with suppress(Exception):  # what is printed so far; the signal may have come in the middle of it
        sys.stdout.flush()
    # a progress bar hides the cursor and leaves its line
    begin = "\r\x1b[K\x1b[?25h" if os.isatty(2) else ""
    with suppress(OSError):
        os.write(2, f"{begin}curvescan: {_sentences[-1]}\n".encode(errors="replace"))
    os._exit(128 + number)
