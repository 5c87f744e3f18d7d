"""Where the machine code of this package's kernels is kept, and that it is never that of another version.

Numba judges stored machine code by the file of the kernel alone, but it holds the code of the kernels called and the
constants read as well (numba#1833). So ours is kept in a folder named after a digest of the sources: in
NUMBA_CACHE_DIR, else beside the package in its __pycache__, else in the user's cache folder. Nothing in the folder says
where the package is installed: it is also read in NUMBA_CACHE_DIR where that cannot be written, and in the package, as
`_kernels`. Code for this processor is taken first, then code for any of its kind, which has the same results.
"""

import contextlib
import functools
import hashlib
import logging
import os
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

_numba_config: Any = numba.config
_ROOT = Path(__file__).parent
_LOGGER = logging.getLogger(__package__)

_DEFINES_KERNELS = re.compile(rf"^from {__package__}\._jit import .*\b(kernel|inlined)\b", re.MULTILINE)
_IMPORT = re.compile(rf"^\s*from ({__package__}(?:\.\w+)*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

_FOLDER_PREFIX = f"{__package__}-kernels-"
_DIGEST_LENGTH = 16
_UNUSED_S = 86_400.0

_SHIPPED = "_kernels"
_ANY_PROCESSOR = ("generic", "")  # name and features, as Numba tells them of code compiled with NUMBA_CPU_NAME=generic

_faults: list[str] = []


@functools.cache
def cache_folder() -> Path | None:
    """Return the folder of this version's machine code, or None where none can be written."""
    for parent, folder in _places():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
        except OSError:
            continue
        _sweep(parent, folder)
        return folder
    return None


@functools.cache
def read_folders() -> tuple[Path, ...]:
    """Return the folders to look for machine code of this version in, the one that is written to first.

    The others are the first choice, where that cannot be written, and what came with the package.
    """
    written, places = cache_folder(), _places()
    found = [folder for _, folder in places[:1]]
    found += [_ROOT / _SHIPPED / folder.name for folder in found]
    found = [folder for folder in found if folder != written and folder.is_dir()]
    return (*([] if written is None else [written]), *found)


def source_digest(root: Path) -> str | None:
    """Return a digest of the sources that machine code can depend on, or None where they are not files.

    These are the files that define kernels and all that they import: an edit elsewhere compiles nothing anew.
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


class _Names(CompileResultCacheImpl):
    """Numba's way to write machine code, under a name that is the same wherever the package is installed."""

    def __init__(self, function: Any) -> None:  # not Numba's, which goes by the path of the file
        self._locator = self
        self._py_file, self._lineno = function.__code__.co_filename, function.__code__.co_firstlineno
        name = f"{function.__module__}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(name, getattr(sys, "abiflags", ""))

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name in one file apart."""
        return str(self._lineno)


class KernelCache(FunctionCache):
    """The machine code of one kernel, whose faults cost time and never a result.

    Code that cannot be read is compiled again; code that cannot be written is not kept, and this is reported once. Two
    processes that write at the same time can mix up two variants of a kernel: loading checks which one it is.
    """

    def __init__(self, function: Any) -> None:  # not Numba's, which looks for a folder for each function
        self._name, self._py_func, self._impl = repr(function), function, _Names(function)
        base, folder = self._impl.filename_base, cache_folder()
        self._cache_path = None if folder is None else str(folder)
        self._files = [
            IndexDataCacheFile(cache_path=str(one), filename_base=base, source_stamp=one.name) for one in read_folders()
        ]
        self.enable()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code kept for argument types `sig`, or None."""
        rtsys.initialize(target_context)  # all that this needs of what Numba's refresh() does in half a second
        own = self._index_key(sig, target_context.codegen())
        for key in (own, (sig, (own[1][0], *_ANY_PROCESSOR), own[2])):
            for file in self._files:
                try:
                    data = file.load(key)
                    loaded = data and self._impl.rebuild(target_context, data)
                except Exception:  # noqa: BLE001  a damaged pickle can raise anything
                    loaded = None
                    if file is self._files[0] and self._cache_path is not None:  # what was brought is left as it is
                        with contextlib.suppress(OSError):
                            file.flush()
                if loaded and loaded.signature.args == sig:
                    return loaded
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code for argument types `sig`, if it can be written."""
        if self._cache_path is None:
            _say_not_kept("no folder for it can be written")
            return
        try:
            if self._impl.check_cachable(data):
                Path(self._cache_path).mkdir(parents=True, exist_ok=True)
                self._files[0].save(self._index_key(sig, data.codegen), self._impl.reduce(data))
        except OSError as error:
            _say_not_kept(f"{self._cache_path}: {error.strerror}")


@functools.cache
def _places() -> list[tuple[Path, Path]]:
    """Return where this version's machine code may be written, with the folders that these are in."""
    digest = source_digest(_ROOT)
    parents = [Path(_numba_config.CACHE_DIR)] if _numba_config.CACHE_DIR else []
    parents.append(_ROOT / "__pycache__")
    user = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "~/.cache"
    with contextlib.suppress(RuntimeError):  # a user without a home
        parents.append(Path(user).expanduser())
    return [(one.absolute(), one.absolute() / (_FOLDER_PREFIX + digest)) for one in parents] if digest else []


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
