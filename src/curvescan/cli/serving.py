"""Pages that a command serves: their port, the browser, and waiting until Ctrl-C."""

from __future__ import annotations

import os
import socket
import sys
import time
import webbrowser

from curvescan._interrupts import stoppable

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
    from curvescan.cli.console import ERR

    with stoppable() as stop:
        ERR.print(sentence)
        while not stop.is_asked:
            time.sleep(_POLL_S)
