"""An LDROBOT LD19 on a pseudo terminal: 47-byte packets of 12 points with their CRC, as its manual has them."""

from __future__ import annotations

import os
import pty
import struct
import threading
import time
import tty

import numpy as np

from curvescan import LaserScan

N_POINTS = 12
PACKETS_A_TURN = 38
HEADER, VERSION = 0x54, 0x2C


def crc8(data: bytes) -> int:
    """CRC-8, polynomial 0x4D, bit by bit: written from the manual, not from a table."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x4D if crc & 0x80 else crc << 1) & 0xFF
    return crc


def packet(degrees: list[float], millimetres: list[int], rate_hz: float) -> bytes:
    """One packet; the sensor turns clockwise, and its angles count so."""
    body = struct.pack("<BBHH", HEADER, VERSION, round(360 * rate_hz), round(100 * degrees[0]) % 36000)
    for distance in millimetres:
        body += struct.pack("<HB", distance, 200)
    body += struct.pack("<HH", round(100 * degrees[-1]) % 36000, 0)
    return body + bytes([crc8(body)])


def turn_packets(scan: LaserScan, rate_hz: float, jitter_deg: float = 0.0) -> list[bytes]:
    """The packets of one turn that sees what a scan saw; begins at 0 degrees, give or take a jitter."""
    n = N_POINTS * PACKETS_A_TURN
    degrees = (np.arange(n) * 360.0 / n + jitter_deg) % 360.0
    steps = (np.radians(-degrees) - scan.angle_min) / scan.angle_increment
    nearest = np.rint(steps).astype(int) % len(scan)  # of a full circle of evenly spaced beams
    ranges = np.where(scan.valid, scan.ranges, 0.0)[nearest]
    millimetres = np.rint(1e3 * ranges).astype(int).clip(0, 65535)
    return [
        packet(degrees[k : k + N_POINTS].tolist(), millimetres[k : k + N_POINTS].tolist(), rate_hz)
        for k in range(0, n, N_POINTS)
    ]


class Ld19:
    """Sends packets to a pseudo terminal, whose other end is `port`."""

    def __init__(self) -> None:
        self._ours, theirs = pty.openpty()
        tty.setraw(theirs)
        self.port = os.ttyname(theirs)
        self._theirs = theirs
        self.sent_at: list[float] = []
        self._thread: threading.Thread | None = None
        self._is_over = threading.Event()
        self._unplugging = threading.Lock()

    def send(self, data: bytes) -> None:
        """Send bytes, however many."""
        view = memoryview(data)
        while view and not self._is_over.is_set():
            view = view[os.write(self._ours, view[:1024]) :]

    def play(self, turns: list[list[bytes]], period: float, *, held: range = range(0)) -> None:
        """Send turns at their time in a thread; those of `held` come together with the one after them."""

        def run() -> None:
            start = time.monotonic()
            waiting = b""
            for k, packets in enumerate(turns):
                for i, one in enumerate(packets):
                    due = start + period * (k + (i + 1) / len(packets))
                    if self._is_over.wait(max(due - time.monotonic(), 0.0)):
                        return
                    waiting += one
                    if k not in held:
                        try:
                            self.send(waiting)
                        except OSError:
                            return
                        waiting = b""
                self.sent_at.append(time.monotonic())

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def wait(self, after: float = 0.5) -> None:
        """Wait until all is sent, and a little longer."""
        if self._thread is not None:
            self._thread.join()
        time.sleep(after)

    def unplug(self) -> None:
        """Pull the plug."""
        self._is_over.set()
        if self._thread is not None:
            self._thread.join()
        with self._unplugging:
            ours, self._ours = self._ours, -1
        if ours >= 0:
            os.close(ours)
            os.close(self._theirs)
