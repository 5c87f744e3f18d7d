"""NpzFile: the arrays of an .npz file, a zip archive with one .npy file an array, read a block of rows at a time.

The shape and type in each header must agree with the bytes that are there before anything is reserved; nothing is
unpickled.
"""

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike, NDArray

from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.lines import is_packed, printable, temporary_folder, unpack, unpacked_limit
from curvescan.types import Floats

_BLOCK_BYTES = 1 << 20
_MAX_WHOLE_BYTES = 64 << 20
_MAX_MEMBERS = 256
_MAX_HEADER_BYTES = 512
"""NumPy writes 118 for an array of plain numbers; deeply nested text would exhaust Python's parser."""
_HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, RuntimeError, ValueError, KeyError,
    TypeError, SyntaxError, MemoryError, RecursionError,
)  # fmt: skip
"""What zipfile, zlib and NumPy raise over bytes that are not as they should be."""


@dataclass(frozen=True, kw_only=True)
class NpyHeader:
    """What stands at the head of an array."""

    shape: tuple[int, ...]  # its bytes are there, as far as the archive shows
    dtype: np.dtype[np.generic]  # A number of at most 8 bytes
    is_fortran: bool  # whether the first index runs fastest
    n_bytes: int  # length of the header


class NpzFile:
    """The arrays of an .npz file; no file stays open between the readings. Raises LogFileError, LogFormatError.

    names: of the arrays that are looked at, None for all; most_bytes: they may unpack to, however small the file is.
    """

    def __init__(self, path: Path, *, names: Collection[str] | None = None, most_bytes: int = 0) -> None:
        self.path = path
        self._file = self._unpacked(path)
        self.n_given = path.stat().st_size  # bytes
        self.headers: dict[str, NpyHeader] = {}
        with self._opened() as archive:
            for info in self._members(archive, names, most_bytes):
                with archive.open(info) as member:
                    name = info.filename.removesuffix(".npy")
                    self.headers[name] = self._header(member, name, info.file_size)

    def read(self, name: str, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Return a whole array, in its own shape."""
        header = self.headers[name]
        values = np.empty(header.shape, dtype)
        rows, first = values.reshape(header.shape or 1), 0
        for block in self.blocks(name):
            rows[first : first + len(block)] = block
            first += len(block)
        return values

    def blocks(self, name: str) -> Iterator[Floats]:
        """Yield the rows of an array as float64, at most a MiB at once; one in Fortran's order is read whole."""
        header = self.headers[name]
        n_rows, *rest = header.shape or (1,)
        row_bytes = header.dtype.itemsize * math.prod(rest)
        with self._opened() as archive, archive.open(f"{name}.npy") as member:
            self._read(member, header.n_bytes)
            if header.is_fortran and rest:
                if 8 * math.prod(header.shape) > max(_MAX_WHOLE_BYTES, 10 * self.n_given):
                    raise self._unreadable(
                        f"array {name!r} is in Fortran's order and too large: save numpy.ascontiguousarray of it"
                    )
                data = self._read(member, n_rows * row_bytes)
                yield self._values(data, header.dtype).reshape(header.shape, order="F")
                return
            n_left = n_rows
            while n_left:
                n = min(n_left, max(1, _BLOCK_BYTES // max(row_bytes, 1)))
                data = self._read(member, n * row_bytes)
                yield self._values(data, header.dtype).reshape(n, *rest)
                n_left -= n

    def row(self, name: str, i: int) -> Floats:
        """Return row i of an array of two dimensions as float64; what stands before it is skipped."""
        header = self.headers[name]
        if header.is_fortran:
            found: Floats = self.read(name)[i]
            return found
        n_bytes = header.dtype.itemsize * header.shape[1]
        with self._opened() as archive, archive.open(f"{name}.npy") as member:
            with self._own_errors():
                member.seek(header.n_bytes + i * n_bytes)
            return self._values(self._read(member, n_bytes), header.dtype)

    def _members(
        self, archive: zipfile.ZipFile, names: Collection[str] | None, most_bytes: int
    ) -> list[zipfile.ZipInfo]:
        members = archive.infolist()
        if len(members) > _MAX_MEMBERS:
            raise self._unreadable(f"it holds {len(members):,} files, an .npz of scans a dozen")
        for info in members:
            name = info.filename
            if not name.endswith(".npy"):
                raise self._unreadable(f"it holds {name[:40]!r}, which is no array")
            if info.compress_type not in _METHODS or info.flag_bits & 1:
                raise self._unreadable(f"array {name[:40]!r} is packed in another way than NumPy does")
        if len({info.filename for info in members}) < len(members):
            raise self._unreadable("two arrays have the same name")
        if names is not None:
            members = [info for info in members if info.filename.removesuffix(".npy") in names]
        limit = max(unpacked_limit(self._file), most_bytes)
        if sum(info.file_size for info in members) > limit:
            raise self._unreadable(
                f"it unpacks to more than {limit >> 20:,} MiB, too much for a log of its size: if it is sound, save it "
                "with numpy.savez"
            )
        return members

    def _header(self, member: IO[bytes], name: str, file_size: int) -> NpyHeader:
        """Return the header of an array as NumPy reads it, having compared it with the bytes that are there."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # NumPy warns of headers that Python 2 wrote
                version = npy.read_magic(member)
                shape, is_fortran, dtype = _HEADER_READERS[version](member, max_header_size=_MAX_HEADER_BYTES)
        except KeyError:
            raise self._unreadable(
                f"array {name!r} is of a version of the NPY format that holds no plain numbers"
            ) from None
        except (ValueError, SyntaxError, tokenize.TokenError) as error:  # NumPy evaluates a literal
            reason = printable(str(error).split("\n")[0], 120)
            raise self._unreadable(
                f"array {name!r} does not begin like one that numpy.savez wrote ({reason})"
            ) from error
        if dtype.kind not in "fiub" or dtype.itemsize > 8 or dtype.subdtype is not None:
            raise self._unreadable(f"array {name!r} must hold plain numbers, got type {dtype}")
        if not all(n >= 0 for n in shape) or len(shape) > 2:
            raise self._unreadable(f"array {name!r} must have at most two dimensions, got {shape}")
        n_claimed, n_there = math.prod(shape) * dtype.itemsize, file_size - member.tell()
        if n_claimed != n_there:
            raise self._unreadable(
                f"array {name!r} says that it is {shape} of {dtype}, {n_claimed:,} bytes, and has {n_there:,}"
            )
        return NpyHeader(shape=tuple(shape), dtype=dtype, is_fortran=is_fortran, n_bytes=member.tell())

    def _read(self, member: IO[bytes], n_bytes: int) -> bytes:
        with self._own_errors():
            data = member.read(n_bytes)
            if len(data) < n_bytes:
                raise EOFError
            return data

    @staticmethod
    def _values(data: bytes, dtype: np.dtype[np.generic]) -> Floats:
        values: NDArray[np.generic] = np.frombuffer(data, dtype=dtype)
        with np.errstate(invalid="ignore"):  # a signalling NaN of float32 is a NaN
            return values.astype(np.float64)

    def _unpacked(self, path: Path) -> Path:
        if not is_packed(path):
            return path
        unpacked = temporary_folder(self) / "npz"
        unpack(path, unpacked)  # what is missing of its end, the archive's reader finds
        return unpacked

    @contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        if not self._file.is_file():
            raise LogFileError(f"cannot read {self.path}: it has gone since it was opened")
        with self._own_errors():
            archive = zipfile.ZipFile(self._file)
        with self._own_errors(), archive:
            yield archive

    @contextmanager
    def _own_errors(self) -> Iterator[None]:
        try:
            yield
        except (LogFileError, LogFormatError):
            raise
        except _DAMAGE as error:
            raise self._unreadable(f"it is damaged ({type(error).__name__})") from error
        except OSError as error:
            raise LogFileError(f"cannot read {self.path}: {error.strerror or error}") from error

    def _unreadable(self, reason: str) -> LogFormatError:
        return LogFormatError(f"{self.path} is an .npz file that cannot be read: {reason}")
