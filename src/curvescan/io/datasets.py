"""curvescan.datasets: public logs, downloaded once, checked and kept.

Nothing is shipped: each file comes from the public repository that holds it. Its SHA-256 stands here, so that the same
name is the same bytes for everybody. Where a repository publishes a file compressed, the digest is that of the content.
"""

from __future__ import annotations

import bz2
import difflib
import io
from dataclasses import dataclass
from pathlib import Path

from curvescan.errors import InvalidArgumentError, SourceError

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


_CC_BY = "CC BY, as stated by the SLAM benchmark of the University of Freiburg"
_MUMBLE = "RicoJia/Mumble-Robot"
_JIA = "R. R. Jia, Mumble-Robot, 2025"

DATASETS: dict[str, Dataset] = {
    "intel": Dataset(
        about="SICK laser and wheels, Intel Research Lab in Seattle: 13,631 scans, 45 minutes, 508 m",
        path="MOLAorg/mola_test_datasets/HEAD/datasets/radish/intel.clf.bz2",
        n_bytes=16_433_447,
        sha256="8db0ad6231b48bad4118e6a2dc78e83213b2c306be3b4ed80a90969891abfe7b",
        licence=_CC_BY,
        citation="D. Haehnel, Intel Research Lab, in Radish, the robotics data set repository",
    ),
    "intel.relations": Dataset(
        about="2,984 relative poses of the log intel, checked by hand",
        path="xiaofeng419/SLAM-2D-LIDAR-SCAN/50506031f42018fc03ea5ca12c5350717726b83e/DataSet/RawData/intel.relations",
        n_bytes=265_713,
        sha256="330378f153eeae652d6756c1746f335801f66c3e097d90611548e6c4f593c359",
        licence=_CC_BY,
        citation="R. Kuemmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009",
    ),
    "kitchen": Dataset(
        about="RPLIDAR A1 on a small rover in a flat, no wheels: 675 scans, 97 s; clockwise beams, some stale",
        path=f"{_MUMBLE}/d233e8f417a1dab64e2db7b8337fdcb4075a0d94/"
        "mumble_simulation_isaac/bags/kitchen_1/kitchen_1/my_data_bag_0.db3",
        n_bytes=2_793_472,
        sha256="7eaac0677d6d8cd7773559ac5f118b2c2fe0a847f477c3c351ea66f9c64c680f",
        licence="BSD-2-Clause",
        citation=_JIA,
    ),
    "hallway": Dataset(
        about="the rover of kitchen in a hallway: 789 scans, 112 s",
        path=f"{_MUMBLE}/b3462bb275ff0cfac71123053719ecf888bfa769/"
        "mumble_simulation_isaac/bags/slow_half_hallway/my_data_bag/my_data_bag_0.db3",
        n_bytes=3_244_032,
        sha256="fe99b73944c7cc267449439e915eebaf9522be1f232f3f70949649c0ee649bdb",
        licence="BSD-2-Clause",
        citation=_JIA,
    ),
    "pedestrians": Dataset(
        about="Hokuyo URG-04LX that stands still while people walk past: 1,265 scans, 126 s",
        path="angusleigh/leg_tracker/24ec1bb31c00089a16ff39fe06fd4b07af9a5430/"
        "rosbags/demos/demo_stationary_simple_environment.bag",
        n_bytes=2_745_748,
        sha256="3f3a4132452fc25afcdb9c4d2f610c1babb05ebbe491297da1460cbf5b58e3db",
        licence="BSD-3-Clause",
        citation="A. Leigh et al., Person tracking and following with 2D laser scanners, ICRA 2015",
    ),
}
"""The public files by name."""


def fetch(name: str) -> Path:
    """Return the path of a public file, downloaded on its first use.

    The file is kept in the user's cache folder, or in the folder that the environment variable CURVESCAN_DATASETS
    names. Its licence and whom to cite are printed once, with the download.

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
    if name not in DATASETS:
        near = difflib.get_close_matches(str(name), DATASETS, n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        raise InvalidArgumentError(f"a data set must be one of {', '.join(DATASETS)}, got {name!r}{meant}")
    import pooch

    row = DATASETS[name]
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
            f"cannot download {name} from {url}: {_reason(error)}; {_remedy(store.abspath / file)}"
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


def _remedy(path: Path) -> str:
    return f"try again later, or save the unpacked file as {path}"
