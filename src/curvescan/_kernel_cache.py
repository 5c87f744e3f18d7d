"""Where the machine code of this package's kernels is kept, and that it is never that of another version.

Numba judges stored machine code by the file of the kernel alone, but it holds the code of the kernels
called and the constants read as well (numba#1833): after an upgrade it would run old code. So this
package's machine code is kept in a folder named after a digest of the package's sources: in
NUMBA_CACHE_DIR, else beside the package in its __pycache__, else in the user's cache folder. Folders of
other digests are removed once they have not been used for a day. Removing one that is in use does no
harm: what is missing is compiled again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

_numba_config: Any = numba.config
_ROOT = Path(__file__).parent
_LOGGER = logging.getLogger(__package__)

_DEFINES_KERNELS = re.compile(rf"^from {__package__}\._jit import .*\b(kernel|inlined)\b", re.MULTILINE)
_IMPORT = re.compile(rf"^\s*from ({__package__}(?:\.\w+)*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

_FOLDER_PREFIX = f"{__package__}-kernels-"
_DIGEST_LENGTH = 16
_UNUSED_S = 86_400.0

_faults: list[str] = []
_setting_numba = threading.Lock()


@functools.cache
def cache_folder() -> Path | None:
    """Return the folder of this version's machine code, or None where none can be written."""
    digest = source_digest(_ROOT)
    if digest is None:
        return None
    for parent in _cache_parents():
        folder = parent / (_FOLDER_PREFIX + digest)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
        except OSError:
            continue
        _sweep(parent, folder)
        return folder
    return None


@contextlib.contextmanager
def numba_caches_in(folder: Path) -> Iterator[None]:
    """Let Numba choose `folder` for what is decorated inside, and for nobody else's kernels."""
    wanted = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": ""}
    with _setting_numba:
        usual = {k: getattr(_numba_config, k) for k in wanted if hasattr(_numba_config, k)}
        try:
            for name in usual:
                setattr(_numba_config, name, wanted[name])
            yield
        finally:
            for name, value in usual.items():
                setattr(_numba_config, name, value)


def source_digest(root: Path) -> str | None:
    """Return a digest of the sources that machine code can depend on, or None where they are not files.

    These are the files that define kernels and whatever they import, directly or not: an edit elsewhere compiles
    nothing anew.
    """
    try:
        sources = {
            ".".join(path.relative_to(root.parent).with_suffix("").parts).removesuffix(".__init__"): path.read_bytes()
            for path in root.rglob("*.py")
        }
    except OSError:
        return None
    texts = {name: source.decode() for name, source in sources.items()}
    reached: set[str] = set()
    ahead = [name for name, text in texts.items() if _DEFINES_KERNELS.search(text)]
    while ahead:
        name = ahead.pop()
        if name in reached:
            continue
        reached.add(name)
        for module, names in _IMPORT.findall(texts[name]):
            words = module.split(".")
            parents = [".".join(words[:n]) for n in range(2, len(words) + 1)]
            taken = (*parents, *(f"{module}.{word}" for word in re.findall(r"\w+", names)))
            ahead += [known for known in taken if known in texts]
    digest = hashlib.sha256()
    for name in sorted(reached):
        digest.update(f"{name!a} {len(sources[name])} ".encode())
        digest.update(sources[name])
    return digest.hexdigest()[:_DIGEST_LENGTH] if reached else None


class ForgivingCache:
    """Numba's cache of one kernel, whose faults cost time and never a result.

    What cannot be read (cut short by a full disk or a lost power supply) is compiled again; what cannot
    be written is not kept, which is said once. Two processes that compile two variants of one kernel at
    the same time can leave an index that names the one for the other; this is noticed here.
    """

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code kept for argument types `sig`, or None."""
        try:
            loaded = self._cache.load_overload(sig, target_context)
        except Exception:  # noqa: BLE001  a damaged pickle can raise anything
            loaded = None
            with contextlib.suppress(OSError):
                self._cache.flush()
        return loaded if loaded is not None and loaded.signature.args == sig else None

    def save_overload(self, sig: Any, compiled: Any) -> None:
        """Keep machine code for argument types `sig`, if it can be written."""
        try:
            self._cache.save_overload(sig, compiled)
        except OSError as error:
            _say_not_kept(f"{self._cache.cache_path}: {error.strerror}")
        if self._cache.cache_path is None:
            _say_not_kept("no folder for it can be written")


def _cache_parents() -> list[Path]:
    parents = [Path(_numba_config.CACHE_DIR)] if _numba_config.CACHE_DIR else []
    parents.append(_ROOT / "__pycache__")
    user = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "~/.cache"
    with contextlib.suppress(RuntimeError):  # a user without a home
        parents.append(Path(user).expanduser())
    return [parent.absolute() for parent in parents]


def _sweep(parent: Path, used: Path) -> None:
    """Remove the machine code of other versions that none has used for a day."""
    for folder in parent.glob(_FOLDER_PREFIX + "[0-9a-f]" * _DIGEST_LENGTH):
        with contextlib.suppress(OSError):  # another process may sweep at the same time
            if folder != used and time.time() - folder.stat().st_mtime > _UNUSED_S:
                shutil.rmtree(folder, ignore_errors=True)


def _say_not_kept(reason: str) -> None:
    if not _faults:
        _LOGGER.warning(
            "%s cannot keep its machine code (%s) and compiles it anew at each start, which takes "
            "seconds; set NUMBA_CACHE_DIR to a folder that can be written",
            __package__,
            reason,
        )
    _faults.append(reason)
