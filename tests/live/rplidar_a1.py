"""An RPLIDAR A1 on a pseudo terminal: commands and replies of Slamtec's "Interface protocol and application notes"."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import pty
import select
import struct
import threading
import time
import tty

from curvescan import LaserScan

SYNC, STOP, SCAN, HEALTH, SET_PWM = 0xA5, 0x25, 0x20, 0x52, 0xF0
HEALTH_REPLY = b"\xa5\x5a\x03\x00\x00\x00\x06" + b"\x00\x00\x00"
SCAN_REPLY = b"\xa5\x5a\x05\x00\x00\x40\x81"


def sample(degrees: float, metres: float, *, is_first: bool, quality: int = 47) -> bytes:
    """Five bytes: quality with the start flag and its inverse, angle * 64 with the check bit, millimetres * 4."""
    start = (quality << 2) | (0b01 if is_first else 0b10)
    angle = (round(64 * (degrees % 360.0)) << 1) | 1
    return struct.pack("<BHH", start, angle & 0xFFFF, min(round(4000 * metres), 0xFFFF))


def turn_bytes(scan: LaserScan) -> bytes:
    """What a turn that sees a scan sends; it turns clockwise, and its angles count so."""
    angles = [-math.degrees(a) % 360.0 for a in scan.angles]
    order = sorted(range(len(scan)), key=angles.__getitem__)
    return b"".join(
        sample(angles[i], scan.ranges[i] if scan.valid[i] else 0.0, is_first=k == 0) for k, i in enumerate(order)
    )


class RplidarA1:
    """Answers commands, and sends turns once it is told to scan; `port` is its other end."""

    def __init__(self, turns: list[bytes], period: float, *, held: range = range(0)) -> None:
        self._ours, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._turns, self._period, self._held = turns, period, held
        self.commands: list[int] = []
        self._is_over = threading.Event()
        self._unplugging = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            while not self._is_over.is_set():
                if not select.select([self._ours], [], [], 0.05)[0]:
                    continue
                request = os.read(self._ours, 64)
                self.commands += [b for a, b in itertools.pairwise(request) if a == SYNC]
                if HEALTH in request:
                    os.write(self._ours, HEALTH_REPLY)
                if bytes([SYNC, SCAN]) in request:
                    os.write(self._ours, SCAN_REPLY)
                    self._send()

    def _send(self) -> None:
        start, waiting = time.monotonic(), b""
        for k, turn in enumerate(self._turns):
            n = max(len(turn) // 10 // 5 * 5, 5)  # in ten pieces, each of whole samples
            pieces = [turn[i : i + n] for i in range(0, len(turn), n)]
            for i, piece in enumerate(pieces):
                due = start + self._period * (k + (i + 1) / len(pieces))
                if self._is_over.wait(max(due - time.monotonic(), 0.0)):
                    return
                waiting += piece
                if k not in self._held:
                    view = memoryview(waiting)
                    while view and not self._is_over.is_set():
                        view = view[os.write(self._ours, view[:1024]) :]
                    waiting = b""

    def unplug(self) -> None:
        """Pull the plug, which a timer and the end of a test may do at once."""
        self._is_over.set()
        self._thread.join()
        with self._unplugging:
            ours, self._ours = self._ours, -1
        if ours >= 0:
            os.close(ours)
            os.close(self._theirs)
