"""Claims on logs: batches that share a bucket take each log once, without talking to each other.

A claim is an object that only one batch can create (a conditional put). Its owner writes it anew every few seconds. One
that does not change for `LEASE_S` belongs to a batch that has died, and may be replaced, again on condition that nobody
else has done so. Clocks of different machines are never compared: each batch measures the age of a claim by its own.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from contextlib import suppress

from curvescan.errors import OutputError, StorageError
from curvescan.runs.batch.storage.object_store import Bucket

LEASE_S = 60.0  # a claim that has not changed for so long is nobody's, seconds
_RENEWALS = 4


class Claims:
    """The claims of one batch in a folder of a bucket."""

    def __init__(self, bucket: Bucket, prefix: str, options: str, *, lease: float = LEASE_S) -> None:
        self._bucket, self._prefix, self._options, self._lease = bucket, prefix, options, lease
        self._owner = f"{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:8]}"
        self._held: dict[str, str] = {}
        self._seen: dict[str, tuple[str, float]] = {}
        self._n_written = 0
        self._lock = threading.RLock()  # a signal may end the batch in the middle of a claim
        self._over = threading.Event()
        threading.Thread(target=self._renew_all, daemon=True).start()

    def take(self, name: str) -> bool:
        """Claim a log, and return whether it is this batch's now. Raises OutputError."""
        with self._lock:
            key = self._key(name)
            tag = self._bucket.create(key, self._content())
            if tag is None:
                tag = self._replace_dead(key, name)
            if tag is not None:
                self._held[name] = tag
            return tag is not None

    def confirm(self, name: str) -> bool:
        """Return whether a log is still this batch's."""
        with self._lock:
            return self._renew(name)

    def release(self, name: str) -> None:
        """Give up a claim."""
        with self._lock:
            if self._held.pop(name, None) is not None:
                self._bucket.delete(self._key(name))

    def close(self) -> None:
        """Give up all claims."""
        self._over.set()
        for name in list(self._held):
            with suppress(StorageError):  # the lease runs out as well
                self.release(name)

    def _key(self, name: str) -> str:
        return f"{self._prefix}/{name}.json"

    def _content(self) -> bytes:
        self._n_written += 1  # each write has a tag of its own, which shows that the owner lives
        claim = {"owner": self._owner, "options": self._options, "renewal": self._n_written}
        return json.dumps(claim).encode()

    def _replace_dead(self, key: str, name: str) -> str | None:
        found = self._bucket.read(key)
        if found is None:
            return None  # released meanwhile: tried again later
        content, tag = found
        claim = _parse(content)
        seen, since = self._seen.get(name, ("", 0.0))
        if seen != tag:
            since = time.monotonic()
            self._seen[name] = (tag, since)
        if time.monotonic() - since > self._lease or _is_dead(claim.get("owner", "")):
            return self._bucket.replace(key, self._content(), tag)
        if claim.get("options") != self._options:
            raise OutputError(
                f"a batch with other options writes to the same folder ({claim.get('owner')} runs {name}): "
                "wait for it, or choose another folder"
            )
        return None

    def _renew(self, name: str) -> bool:
        tag = self._held.get(name)
        if tag is None:
            return False
        new = self._bucket.replace(self._key(name), self._content(), tag)
        if new is None:  # this process stood still for longer than the lease
            del self._held[name]
            return False
        self._held[name] = new
        return True

    def _renew_all(self) -> None:
        while not self._over.wait(self._lease / _RENEWALS):
            for name in list(self._held):
                # a store that cannot be reached now is tried again at the next turn
                with self._lock, suppress(StorageError):
                    self._renew(name)


def _parse(content: bytes) -> dict[str, str]:
    try:
        claim = json.loads(content)
    except ValueError:
        return {}
    return claim if isinstance(claim, dict) else {}


def _is_dead(owner: object) -> bool:
    """Return whether a claim's owner is a process of this machine that has ended: nobody waits for its lease."""
    host, _, rest = str(owner).partition(":")
    pid = rest.partition(":")[0]
    if host != socket.gethostname() or not pid.isdigit() or os.name != "posix":
        return False
    try:
        os.kill(int(pid), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:
        return False
    return False
