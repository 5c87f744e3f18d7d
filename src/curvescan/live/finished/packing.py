"""packed: arrays and words in one deflated block of bytes that the page takes apart.

The length of a JSON text, the text, then the arrays one after the other; in the text an array is its type, place and
length.
"""

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

_TYPES = {"<f4": "Float32Array", "<f8": "Float64Array", "|u1": "Uint8Array", "<u2": "Uint16Array", "<i4": "Int32Array"}
_ALIGNED = 8  # each array begins at a multiple of this, as a typed array of JavaScript must


def packed(tree: Any) -> bytes:
    """Return a tree of mappings, sequences, arrays and plain values as a deflated block; NaN only within arrays."""
    blocks: list[bytes] = []
    text = json.dumps(_plain(tree, blocks), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNED)
    return zlib.compress(len(text).to_bytes(4, "little") + text + b"".join(blocks), 6)


def _plain(value: Any, blocks: list[bytes]) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(one, blocks) for key, one in value.items()}
    if isinstance(value, bytes):
        return _plain(np.frombuffer(value, np.uint8), blocks)
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        if array.dtype.str not in _TYPES:
            array = array.astype("<f4" if array.dtype.kind == "f" else "<i4")
        at = sum(map(len, blocks))
        data = array.tobytes()
        blocks.append(data + b"\0" * (-len(data) % _ALIGNED))
        return {"array": _TYPES[array.dtype.str], "at": at, "n": array.size}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one, blocks) for one in value]
    return value
