"""CheckedPath: no length that a file claims makes its reader reserve memory or read for ever.

``read(n)`` of an ordinary file reserves n bytes before it reads. A damaged or hostile file may claim any n.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import Any, BinaryIO, cast

from curvescan.errors import LogFormatError

MIN_READ_LIMIT = 1 << 30
"""So many bytes a file may be read to from its opening to its closing, and MAX_READ_RATIO times its size."""

MAX_READ_RATIO = 100

_SMALL = 1 << 16
_NOTHING_TO_SEE = 8
_RECORD_READ = 2


class CheckedPath:
    """A path as rosbags takes them (its protocol RPath), whose file never reads beyond its end."""

    def __init__(
        self,
        path: Path,
        look: Callable[[bytes], None] | None = None,
        rewrite: Callable[[int, bytes], bytes] | None = None,
    ) -> None:
        self._path = path
        self._look = look
        self._rewrite = rewrite

    def __str__(self) -> str:
        return str(self._path)

    def __truediv__(self, key: CheckedPath | PurePath | str) -> CheckedPath:
        return CheckedPath(self._path / str(key), self._look, self._rewrite)

    @property
    def stem(self) -> str:
        """Name without its ending."""
        return self._path.stem

    @property
    def suffix(self) -> str:
        """Ending of the name."""
        return self._path.suffix

    def exists(self) -> bool:
        """Return whether the file is there."""
        return self._path.exists()

    def is_dir(self) -> bool:
        """Return whether it is a folder."""
        return self._path.is_dir()

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        """Return what the system says of the file."""
        return self._path.stat(follow_symlinks=follow_symlinks)

    def read_text(self, encoding: str | None = None) -> str:
        """Return the whole file as text."""
        return self._path.read_text(encoding)

    def open(self, *_: Any, **__: Any) -> BinaryIO:
        """Open the file for reading bytes, whatever mode is given."""
        return cast(BinaryIO, _CheckedFile(io.FileIO(self._path), self._look, self._rewrite))


class _CheckedFile(io.BufferedReader):
    def __init__(
        self, raw: io.FileIO, look: Callable[[bytes], None] | None, rewrite: Callable[[int, bytes], bytes] | None
    ) -> None:
        super().__init__(raw)
        self._look, self._rewrite = look, rewrite
        self._kind, self._n_since = 0, _RECORD_READ
        self._n_bytes = os.fstat(raw.fileno()).st_size
        self._n_left = MIN_READ_LIMIT + MAX_READ_RATIO * self._n_bytes

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _SMALL:
            size = max(0, min(size, self._n_bytes - self.tell()))
        data = super().read(size)
        self._n_left -= len(data)
        if self._n_left < 0:
            raise LogFormatError("its index leads to the same bytes again and again")
        if self._look is not None and len(data) > _NOTHING_TO_SEE:
            self._look(data)
        if self._rewrite is None:
            return data
        # the kind of a record in one byte, its length in eight, the record
        if size == 1 and data:
            self._kind, self._n_since = data[0], 0
        else:
            self._n_since += 1
            if self._n_since == _RECORD_READ:
                data = self._rewrite(self._kind, data)
        return data
