import pytest

from curvescan import simulate, write_log
from curvescan.cli.main import run


@pytest.fixture(scope="package")
def results(tmp_path_factory):
    """The results folder of a SLAM run over two laps of a room."""
    folder = tmp_path_factory.mktemp("view")
    write_log(folder / "room.npz", simulate("room", sensor="spinning-360", n_scans=120))
    assert run(["slam", str(folder / "room.npz"), "--out", str(folder / "out")]) in (0, 3)
    return folder / "out"
