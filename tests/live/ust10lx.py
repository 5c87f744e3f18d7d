"""A Hokuyo UST-10LX on a socket of this machine: SCIP 2.2, as its communication protocol specification has it."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time

import numpy as np

from curvescan import LaserScan

N_STEPS, FRONT, RESOLUTION = 1081, 540, 1440
PARAMETERS = {
    "MODL": "UST-10LX",
    "DMIN": "20",
    "DMAX": "30000",
    "ARES": str(RESOLUTION),
    "AMIN": "0",
    "AMAX": str(N_STEPS - 1),
    "AFRT": str(FRONT),
    "SCAN": "2400",
}


def checked(text: str) -> str:
    """A line with its checksum: the lower six bits of the sum, plus 0x30."""
    return text + chr((sum(text.encode()) & 0x3F) + 0x30)


def encoded(value: int, n: int) -> str:
    """A number in n characters of six bits."""
    return "".join(chr(((value >> (6 * k)) & 0x3F) + 0x30) for k in reversed(range(n)))


def sweep_text(header: str, scan: LaserScan, milliseconds: int) -> bytes:
    """The reply with the distances that a scan saw, in blocks of 64 characters; 65535 where there is no reading."""
    angles = (np.arange(N_STEPS) - FRONT) * 2.0 * math.pi / RESOLUTION
    steps = np.rint((angles - scan.angle_min) / scan.angle_increment).astype(int) % len(scan)
    millimetres = np.where(scan.valid, np.rint(1e3 * scan.ranges), 65535)[steps].astype(int)
    data = "".join(encoded(value, 3) for value in millimetres.tolist())
    lines = [header, checked("99"), checked(encoded(milliseconds, 4))]
    lines += [checked(data[i : i + 64]) for i in range(0, len(data), 64)]
    return ("\n".join(lines) + "\n\n").encode()


class Ust10lx:
    """Answers BM, PP and MD, and then sends sweeps; those of `held` come together with the one after them."""

    def __init__(self, scans: list[LaserScan], period: float, *, held: range = range(0)) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = f"127.0.0.1:{self._server.getsockname()[1]}"
        self._scans, self._period, self._held = scans, period, held
        self._is_over = threading.Event()
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            self._connection, _ = self._server.accept()
            with self._connection.makefile("r", encoding="ascii", newline="\n") as lines:
                for line in lines:
                    command = line.rstrip("\n")
                    reply = [command, checked("00")]
                    if command == "PP":
                        reply += [f"{k}:{v};" + checked(f"{k}:{v}")[-1] for k, v in PARAMETERS.items()]
                    self._connection.sendall(("\n".join(reply) + "\n\n").encode())
                    if command.startswith("MD"):
                        self._send(command)

    def _send(self, command: str) -> None:
        assert self._connection is not None
        start, waiting = time.monotonic(), b""
        for k, scan in enumerate(self._scans):
            due = start + self._period * (k + 1)
            if self._is_over.wait(max(due - time.monotonic(), 0.0)):
                return
            waiting += sweep_text(command, scan, round(1e3 * self._period * k))
            if k not in self._held:
                self._connection.sendall(waiting)
                waiting = b""

    def unplug(self) -> None:
        """Pull the plug."""
        self._is_over.set()
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)
            self._connection.close()
        self._server.close()
        self._thread.join(5.0)
