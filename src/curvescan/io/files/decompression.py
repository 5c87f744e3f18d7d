"""How much compressed data may unpack to.

A few bytes can stand for gigabytes. Recorded scans shrink to a tenth, and simulated ones that see nothing to a
hundredth; what claims more is refused before it fills memory or disk.
"""

from __future__ import annotations

from pathlib import Path

MIN_UNPACKED_LIMIT = 64 << 20  # up to this many bytes a file may always unpack to
MAX_UNPACKED_RATIO = 100  # beyond, it may unpack to this many times its size

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def unpacked_limit(path: Path) -> int:
    """Return how many bytes a compressed file may unpack to."""
    return max(MIN_UNPACKED_LIMIT, MAX_UNPACKED_RATIO * path.stat().st_size)
