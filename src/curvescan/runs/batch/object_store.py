"""Buckets (S3, Google Cloud Storage, Azure Blob Storage) by obstore, of the extra ``cloud``, and claims on logs.

A claim is an object that only one batch can create (a conditional put), and whose owner writes it anew every few
seconds. One that does not change for `LEASE_S` belongs to a batch that has died, and may be replaced, again on
condition. Clocks of different machines are never compared.
"""

import json
import os
import re
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

from curvescan.errors import InvalidArgumentError, MissingPackageError, OutputError, StorageError

SCHEMES = ("s3", "gs", "az")
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT", "AZURE_STORAGE_ENDPOINT", "GOOGLE_BASE_URL")
_RETRIES: Any = {"max_retries": 4, "retry_timeout": timedelta(seconds=60)}
_REQUEST_S = 120
_PART_BYTES = 8 << 20  # so much is fetched with one request: a slow line still ends each in time


@dataclass(frozen=True, kw_only=True)
class StoredObject:
    """An object as its bucket lists it."""

    key: str  # its name in the bucket
    size: int  # bytes
    tag: str  # ETag: another content has another one


def is_url(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is the address of a place on another machine."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", os.fspath(path)) is not None


def split_url(url: str) -> tuple[str, str]:
    """Return a bucket's address and the key in it: ``s3://bucket/a/b`` is ``("s3://bucket", "a/b")``."""
    scheme, _, rest = url.partition("://")
    bucket, _, key = rest.partition("/")
    if scheme not in SCHEMES or not bucket:
        raise InvalidArgumentError(
            f"{url!r} is no address of an object store: s3://BUCKET/KEY, gs://BUCKET/KEY or az://CONTAINER/KEY"
        )
    return f"{scheme}://{bucket}", key.strip("/")


class Bucket:
    """A bucket. Raises MissingPackageError, StorageError."""

    def __init__(self, address: str) -> None:
        try:
            import obstore
            from obstore.store import from_url
        except ImportError as error:
            raise MissingPackageError(
                f"{address} is in an object store, which needs obstore: pip install 'curvescan[cloud]'"
            ) from error
        self.address = address
        self._obstore = obstore
        self._versions: dict[tuple[str, str], str] = {}
        options: Any = {"timeout": timedelta(seconds=_REQUEST_S)}
        if any(os.environ.get(name, "").startswith("http://") for name in _ENDPOINTS):
            options["allow_http"] = True  # somebody's own server, named by its user
        with self._one_sentence("open", ""):
            self._store = from_url(address, client_options=options, retry_config=_RETRIES)

    def list(self, prefix: str) -> list[StoredObject]:
        """Return the objects whose keys begin with the folders of a prefix (``a/b`` is not in ``a/bc``)."""
        with self._one_sentence("list", prefix):
            parts: list[Any] = list(self._obstore.list(self._store, prefix=prefix or None))
        return [_stored(meta) for part in parts for meta in part]

    def list_folders(self, prefix: str) -> set[str]:
        """Return the names of the folders in a folder."""
        with self._one_sentence("list", prefix):
            found: Any = self._obstore.list_with_delimiter(self._store, prefix=prefix or None)
        return {str(folder).rstrip("/").rpartition("/")[2] for folder in found["common_prefixes"]}

    def find(self, key: str) -> StoredObject | None:
        """Return an object, or None where there is none of that name."""
        with suppress(FileNotFoundError), self._one_sentence("read", key):
            return _stored(self._obstore.head(self._store, key)) if key else None
        return None

    def read(self, key: str) -> tuple[bytes, str] | None:
        """Return the content of a small object and its tag, or None where there is none."""
        with suppress(FileNotFoundError), self._one_sentence("read", key):
            found = self._obstore.get(self._store, key)
            return bytes(found.bytes()), self._note(key, found.meta)
        return None

    def write(self, key: str, content: bytes) -> str:
        """Write a small object, in place of an older one, and return its tag."""
        with self._one_sentence("write", key):
            return _tag(self._obstore.put(self._store, key, content)["e_tag"])

    def create(self, key: str, content: bytes) -> str | None:
        """Write an object that must not yet exist, and return its tag; None where it does."""
        with suppress(FileExistsError), self._one_sentence("write", key):
            return self._note(key, self._obstore.put(self._store, key, content, mode="create"))
        return None

    def replace(self, key: str, content: bytes, tag: str) -> str | None:
        """Write an object in place of the one of that tag, and return its new tag; None where that is gone."""
        from obstore.exceptions import PreconditionError

        # Google's store asks for the version, the others for the tag
        version = self._versions.pop((key, tag), None)
        mode: Any = {"e_tag": tag} | ({"version": version} if version else {})
        with suppress(FileNotFoundError, PreconditionError), self._one_sentence("write", key):
            return self._note(key, self._obstore.put(self._store, key, content, mode=mode))
        return None

    def delete(self, key: str) -> None:
        """Delete an object; one that is not there is no error."""
        with suppress(FileNotFoundError), self._one_sentence("delete", key):
            self._obstore.delete(self._store, key)

    def download(self, found: StoredObject, path: Path) -> None:
        """Write an object's content into a file: the content that was listed, or an error."""
        from obstore.exceptions import PreconditionError

        with path.open("wb") as file:
            for start in range(0, found.size, _PART_BYTES):
                span = (start, min(start + _PART_BYTES, found.size))
                options: Any = {"range": span} | ({"if_match": found.tag} if found.tag else {})
                try:
                    with self._one_sentence("read", found.key):
                        reply = self._obstore.get(self._store, found.key, options=options)
                        part, is_same = reply.bytes(), _tag(reply.meta["e_tag"]) == found.tag
                except (FileNotFoundError, PreconditionError):
                    is_same = False
                if not is_same:  # a store may leave the condition unread
                    raise StorageError(
                        f"{self.address}/{found.key} was changed or removed while it was read: run the batch again"
                    )
                file.write(part)

    def upload(self, path: Path, key: str) -> None:
        """Write a file's content into an object, in parts where it is large."""
        with self._one_sentence("write", key):
            self._obstore.put(self._store, key, path)

    def _note(self, key: str, found: Any) -> str:
        """Return the tag of an object, and keep the version that goes with it."""
        tag = _tag(found["e_tag"])
        if found["version"]:
            self._versions[key, tag] = found["version"]
        return tag

    @contextmanager
    def _one_sentence(self, what: str, key: str) -> Iterator[None]:
        """Say in a sentence what goes wrong; what the caller asks for (missing, there already, changed) passes."""
        from obstore.exceptions import AlreadyExistsError, BaseError, PreconditionError

        try:
            yield
        except (FileNotFoundError, PreconditionError):
            raise
        except AlreadyExistsError as error:
            raise FileExistsError(key) from error
        except (BaseError, OSError, ValueError) as error:
            reason = str(error).partition("\n")[0].strip()
            raise StorageError(f"cannot {what} {self.address}/{key}: {reason}") from error


def _stored(meta: Any) -> StoredObject:
    return StoredObject(key=meta["path"], size=meta["size"], tag=_tag(meta["e_tag"]))


def _tag(tag: str | None) -> str:
    # some stores' lists (Azure's) leave out the quotes that belong to a tag
    return f'"{tag}"' if tag and not tag.endswith('"') else tag or ""


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
            key = f"{self._prefix}/{name}.json"
            tag = self._bucket.create(key, self._content())
            if tag is None:
                tag = self._replace_dead(key, name)
            if tag is not None:
                self._held[name] = tag
            return tag is not None

    def confirm(self, name: str) -> bool:
        """Return whether a log is still this batch's."""
        with self._lock:
            tag = self._held.get(name)
            if tag is None:
                return False
            new = self._bucket.replace(f"{self._prefix}/{name}.json", self._content(), tag)
            if new is None:  # this process stood still for longer than the lease
                del self._held[name]
                return False
            self._held[name] = new
            return True

    def release(self, name: str) -> None:
        """Give up a claim."""
        with self._lock:
            if self._held.pop(name, None) is not None:
                self._bucket.delete(f"{self._prefix}/{name}.json")

    def close(self) -> None:
        """Give up all claims."""
        self._over.set()
        for name in list(self._held):
            with suppress(StorageError):  # the lease runs out as well
                self.release(name)

    def _content(self) -> bytes:
        self._n_written += 1  # each write has a tag of its own, which shows that the owner lives
        claim = {"owner": self._owner, "options": self._options, "renewal": self._n_written}
        return json.dumps(claim).encode()

    def _replace_dead(self, key: str, name: str) -> str | None:
        found = self._bucket.read(key)
        if found is None:
            return None  # released meanwhile: tried again later
        content, tag = found
        claim: Any = None
        with suppress(ValueError):
            claim = json.loads(content)
        claim = claim if isinstance(claim, dict) else {}
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

    def _renew_all(self) -> None:
        while not self._over.wait(self._lease / _RENEWALS):
            for name in list(self._held):
                # a store that cannot be reached now is tried again at the next turn
                with suppress(StorageError):
                    self.confirm(name)


def _is_dead(owner: object) -> bool:
    """Return whether a claim's owner is a process of this machine that has ended: nobody waits for its lease."""
    host, _, rest = str(owner).partition(":")
    pid = rest.partition(":")[0]
    if host != socket.gethostname() or not pid.isdigit() or os.name != "posix":
        return False
    try:
        os.kill(int(pid), 0)
    except OSError as error:
        return isinstance(error, ProcessLookupError)
    except OverflowError:
        return True
    return False
