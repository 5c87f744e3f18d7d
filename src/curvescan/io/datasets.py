"""curvescan.datasets: public logs, downloaded once from the repositories that hold them, checked and kept.

By the SHA-256 in ``datasets.toml`` (of a file that is published compressed: of its content) the same name is the same
bytes for everybody.
"""

import bz2
import io
from dataclasses import dataclass
from pathlib import Path

from curvescan.configs import look_up, shipped_table
from curvescan.errors import SourceError

__all__ = ["DATASETS", "Dataset", "fetch"]

_HOST = "https://raw.githubusercontent.com"


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """A public file, and where it comes from."""

    about: str  # sensor, place, length
    path: str  # Where the file stands: repository, version, path in it. It is unpacked where the name ends in ``.bz2``.
    # n_bytes, sha256: size and digest of the content
    n_bytes: int
    sha256: str
    # licence, citation: under which licence it may be used, and whom to name
    licence: str
    citation: str


DATASETS = {name: Dataset(**row) for name, row in shipped_table(__package__, "datasets.toml").items()}
"""The public files by name."""


def fetch(name: str) -> Path:
    """Return the path of a public file, downloaded on its first use.

    The file is kept in the user's cache folder, or in the folder that the environment variable CURVESCAN_DATASETS
    names. The download prints the licence of the file and what to cite.

    Parameters
    ----------
    name : str
        A name of the table ``DATASETS``: ``"intel"``, ``"intel.relations"``, ``"kitchen"``, ``"hallway"``,
        ``"pedestrians"``.

    Returns
    -------
    Path
        For :func:`curvescan.read_log`, or for ``relations=`` of :func:`curvescan.evaluate`.

    Raises
    ------
    InvalidArgumentError
        When no file has this name.
    SourceError
        When it is not yet here and cannot be downloaded, or when the content is not the expected one.
    """
    row = look_up(DATASETS, name, "data set")
    import pooch

    url = f"{_HOST}/{row.path}"
    file = name if "." in name else name + Path(row.path.removesuffix(".bz2")).suffix
    store = pooch.create(
        path=pooch.os_cache("curvescan"),
        base_url="",
        env="CURVESCAN_DATASETS",
        registry={file: row.sha256},
        urls={file: url},
    )

    def download(url: str, target: str, store: object) -> None:
        packed = io.BytesIO()
        pooch.HTTPDownloader()(url, packed, store)
        data = packed.getvalue()
        if url.endswith(".bz2"):
            data = bz2.BZ2Decompressor().decompress(data, max_length=row.n_bytes + 1)
        Path(target).write_bytes(data)

    def announce(path: str, action: str, _: object) -> str:
        if action != "fetch":  # which is pooch's word for a file that is there
            pooch.get_logger().info("%s: %s. Licence: %s. Please cite: %s.", name, row.about, row.licence, row.citation)
        return path

    try:
        return Path(store.fetch(file, processor=announce, downloader=download))
    except (OSError, ValueError) as error:
        raise SourceError(
            f"cannot download {name} from {url}: {_reason(error)}; try again later, or save the unpacked file as "
            f"{store.abspath / file}"
        ) from error


def _reason(error: Exception) -> str:
    import requests

    if isinstance(error, requests.HTTPError) and error.response is not None:
        return f"the server answers {error.response.status_code} {error.response.reason}"
    if isinstance(error, requests.RequestException):
        return "no connection"
    if isinstance(error, OSError) and error.errno is not None:
        return error.strerror or str(error)
    return "the content is not the one whose SHA-256 is known"
