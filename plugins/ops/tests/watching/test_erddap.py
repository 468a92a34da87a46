"""A data set of an ERDDAP server as the source of a deployment, from a server on this machine."""

import socket

import numpy as np
import pytest
from erddap_server import Erddap, written_time

from factory.samples import Flight
from glider_twin_ops.watching.arrived_files import FETCHED
from glider_twin_ops.watching.log_of_files import LOG, log_of_files
from glider_twin_ops.watching.sources import NEWEST, fetch_days
from twin.errors import InputError
from twin.records import LogStore
from twin.records.storage.checksums import store_hash

pytest.importorskip("erddapy", reason="the extra erddap is not installed")

FLIGHT = Flight(dives=70, depth=400.0, surface=600.0, step=20.0)
COLUMNS = (
    "time (UTC)", "depth (m)", "pitch (degrees)", "heading (degrees)", "latitude (degrees_north)",
    "longitude (degrees_east)",
)  # fmt: skip
MAPPING = """
vehicle = "Slocum glider"
frame = "FRD"
deployment = { name = "calypso" }

[time]
column = "time (UTC)"
unit = "iso"

[signals]
measured_depth = { column = "depth (m)", unit = "m" }
measured_pitch = { column = "pitch (degrees)", unit = "deg" }
measured_heading = { column = "heading (degrees)", unit = "deg", turns = "clockwise" }
gps_latitude = { column = "latitude (degrees_north)", unit = "deg" }
gps_longitude = { column = "longitude (degrees_east)", unit = "deg" }
"""


@pytest.fixture
def server():
    time = FLIGHT.time
    state = FLIGHT.state(time)
    latitude, longitude = FLIGHT.position(time)
    afloat = state["under"] == 0.0
    rows = np.stack(
        [time, state["depth"], state["pitch"], state["heading"],
         np.where(afloat, latitude, np.nan), np.where(afloat, longitude, np.nan)], axis=1,
    )  # fmt: skip
    with Erddap("calypso", COLUMNS, rows).serving() as made:
        yield made


@pytest.fixture
def made(tmp_path, server, deployment):
    """Makes a deployment in a folder."""
    (tmp_path / "mapping.toml").write_text(MAPPING)
    settings = {"vehicle": "slocum-200", "mapping": str(tmp_path / "mapping.toml")}
    return lambda name: deployment(tmp_path / name, server.address, **settings)


def test_days_are_fetched_once_and_the_newest_again(server, made):
    server.until = FLIGHT.time[0] + 2.5 * 86400.0
    one, clean = made("one"), made("clean")
    first = log_of_files(one, one.folder)
    assert first.changed, first
    with LogStore(one.folder / LOG) as logs:
        before = len(logs)
        assert set(logs.deployments) == {"calypso"}
        # the last dive is half there
        assert np.isfinite(logs.number("dac_north")).tolist() == [True] * (before - 1) + [False]
    assert len(server.asked) == len(set(server.asked)) == 4
    assert not log_of_files(one, one.folder).changed
    server.asked.clear()
    server.until = np.inf
    assert log_of_files(one, one.folder).changed
    assert server.asked == ["2023-11-17", "2023-11-18", "2023-11-19"]
    with LogStore(one.folder / LOG) as logs:
        assert len(logs) == FLIGHT.dives > before
    log_of_files(clean, clean.folder)
    assert store_hash(clean.folder / LOG) == store_hash(one.folder / LOG)


def test_a_server_that_is_down_leaves_what_it_sent_before(server, made):
    one = made("one")
    log_of_files(one, one.folder)
    server.broken = True
    down = log_of_files(one, one.folder)
    assert down.store is not None
    assert not down.changed
    assert "error 503, down for repair" in down.unreadable[0]
    assert len(list((one.folder / FETCHED).glob("*.csv"))) > NEWEST


def test_what_is_no_data_set_is_said(tmp_path, server):
    with pytest.raises(InputError, match="answers with the error 404"):
        fetch_days(server.address.replace("calypso", "calypsos"), tmp_path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        gone = f"http://127.0.0.1:{free.getsockname()[1]}/erddap/tabledap/calypso"
        with pytest.raises(InputError, match="does not answer"):
            fetch_days(gone, tmp_path)


def test_a_day_without_rows_is_asked_for_once(tmp_path, server):
    time = server.rows[:, 0]
    start = FLIGHT.time[0] - FLIGHT.time[0] % 86400.0
    hole = (time >= start + 86400.0) & (time < start + 2 * 86400.0)
    server.rows = server.rows[~hole]
    fetch_days(server.address, tmp_path)
    empty = written_time(start + 86400.0)[:10]
    assert server.asked.count(empty) == 1
    assert not (tmp_path / f"calypso-{empty}.csv").exists()
    fetch_days(server.address, tmp_path)
    assert server.asked.count(empty) == 1
