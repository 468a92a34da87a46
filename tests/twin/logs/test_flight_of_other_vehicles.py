"""`twin flight` of logs that no flight model can read: told in a line that sends nobody round."""

import pytest
from logs import Flight, write_mat

from factory.importing.import_run import import_logs
from twin.__main__ import PROGRAM
from twin.records.store import write_store


@pytest.fixture(scope="module")
def lrauv(tmp_path_factory):
    """Of a propelled vehicle: depth and positions, no attitude, no pump."""
    folder = tmp_path_factory.mktemp("lrauv")
    dataset, _ = import_logs("lrauv", [write_mat(folder / "shore.mat", Flight())])
    return write_store(dataset, folder / "lrauv.zarr")


@pytest.mark.parametrize(
    "words",
    [["flight"], ["flight", "--vehicle", "tethys"], ["flight", "--vehicle", "slocum-200"],
     ["identify"]],
)  # fmt: skip
def test_what_the_log_lacks_is_said_whatever_vehicle_is_given(words, lrauv, tmp_path, capsys):
    command, *options = words
    out = tmp_path / ("mine.xml" if command == "identify" else "flight.nc")
    assert PROGRAM.main([command, str(lrauv), "--out", str(out), *options]) == 2
    told = capsys.readouterr().err
    assert "has no channel measured_pitch (nor " in told
    assert "as buoyancy-driven gliders log them, whatever --vehicle is given" in told
    assert "give --vehicle" not in told


def test_its_overview_is_what_was_measured(lrauv, tmp_path, capsys):
    out = tmp_path / "overview.png"
    assert PROGRAM.main(["plot", str(lrauv), "--out", str(out)]) == 0
    assert out.stat().st_size > 10_000
    assert "without a flight model" in capsys.readouterr().err
