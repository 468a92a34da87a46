"""Logs of DUNE: by its own code (`imcpy`), and by the description of IMC alone."""

import gzip
import struct

import numpy as np
import pytest
from logs import SHARED, circles, refused, said, values

from factory.__main__ import PROGRAM
from factory.importing import import_logs
from factory.importing.messages import MessageTable
from glider_twin_protocols.auv_samples import DECLINATION, OWN, entities, message, packets, track_of
from glider_twin_protocols.lsf_reader import _doppler
from twin.identify.driven_runs import load_runs
from twin.records.attributes import VEHICLE_MJCF
from twin.vehicle.vehicle import load_vehicle

imcpy = pytest.importorskip("imcpy")
OTHER = 31
"""Address of another system"""
TIME, STATE = circles(120.0)
STATE["depth"] = STATE["depth"] * np.clip((TIME - TIME[0] - 4.0) / 30.0, 0.0, 1.0)  # it dives


def checksum(data: bytes) -> int:
    """CRC-16-IBM: polynomial 0x8005, reflected, from 0."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value


def described(
    order: str, number: int, layout: str, *values: float, moment: float, entity: int
) -> bytes:  # fmt: skip
    """A packet by the description of IMC (IMC.xml, 5.4): header, payload, sum.

    Args:
      order: < or >.
      layout: of the payload, for `struct`.
    """
    payload = struct.pack(order + layout, *values)
    header = struct.pack(
        f"{order}HHHdHBHB", 0xFE54, number, len(payload), moment, OWN, entity, 0xFFFF, 0xFF
    )
    return header + payload + struct.pack(f"{order}H", checksum(header + payload))


def log(folder, **changes):
    path = folder / "run.lsf"
    path.write_bytes(b"".join(packets(TIME, {**STATE, **changes})))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    wave = 1e-6 * np.arange(len(TIME))
    fix = {"latitude": 49.5 + wave, "longitude": -58.0 + wave}
    fix["latitude"][3:] = np.nan  # then it is under water
    return import_logs("lsf", [log(tmp_path_factory.mktemp("whole"), **fix)])


def test_units_and_axes_are_those_of_a_store(whole):
    dataset, report = whole
    assert (report.rows, report.period, report.deployments) == (1, 0.2, ("run",))
    exact = {  # of the packets, each in the store's unit
        "measured_roll": STATE["roll"], "measured_pitch": STATE["pitch"],
        "measured_depth": STATE["depth"], "measured_yaw_rate": STATE["yaw_rate"],
        "measured_roll_rate": 0.01, "measured_pitch_rate": -0.02,
        "measured_specific_force_x": 0.1, "measured_specific_force_y": -0.2,
        "measured_specific_force_z": -9.8,
        "measured_propeller": np.round(STATE["rpm"]) * 2.0 * np.pi / 60.0,
        "measured_temperature": 14.0, "measured_salinity": 35.0,
        "measured_voltage": 25.5, "measured_battery_current": 3.5,
    }  # fmt: skip
    for name, expected in exact.items():
        np.testing.assert_allclose(values(dataset, name), expected, atol=2e-4, err_msg=name)
    turned = (values(dataset, "measured_heading") - STATE["heading"] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(turned, 0.0, atol=1e-3)  # the filter's, not the compass's
    # servos 0 and 3 are the rudder, 1 and 2 the elevator; the commands were twice as much
    for kind, twice in (("measured", 1.0), ("commanded", 2.0)):
        rudder, elevator = (values(dataset, f"{kind}_{fin}") for fin in ("rudder", "elevator"))
        np.testing.assert_allclose(rudder, np.degrees(0.12 * twice), atol=1e-4)
        np.testing.assert_allclose(elevator, np.degrees(-0.06 * twice), atol=1e-4)
    assert 1020.0 < values(dataset, "measured_density").mean() < 1030.0
    assert dataset["start_latitude"].values[0] == pytest.approx(49.5, abs=1e-4)
    assert dataset["start_longitude"].values[0] == pytest.approx(-58.0, abs=1e-4)
    assert dataset.attrs[VEHICLE_MJCF] == load_vehicle("remus").xml
    assert float(dataset["thruster_fraction"][0]) == 1.0
    assert "remus" in {e.subject for e in report.entries if "stands for" in e.detail}


def test_a_doppler_log_of_two_references(whole):
    """Water where it has it, else bottom; its mode says which, and when it says nothing."""
    dataset, _ = whole
    ping = np.arange(len(TIME)) % 50
    mode, surge, sway, ground = (
        values(dataset, f"measured_{n}")
        for n in ("dvl_mode", "dvl_surge", "dvl_sway", "bottom_surge")
    )
    bottom, water, none = (ping > 0) & (ping < 4), (ping > 6) & (ping < 44), ping > 46
    assert set(mode[bottom]) == {1.0}
    assert set(mode[none]) == {0.0}
    np.testing.assert_allclose(surge[bottom], STATE["surge"][bottom], atol=1e-4)
    np.testing.assert_allclose(sway[bottom], STATE["sway"][bottom], atol=1e-4)
    np.testing.assert_allclose(ground[ping < 39], STATE["surge"][ping < 39], atol=1e-4)
    assert np.isnan(surge[none & (ping < 48)]).all()
    assert np.isnan(ground[(ping > 41) & (ping < 48)]).all()
    assert set(mode[water]) == {2.0}
    np.testing.assert_allclose(sway[water], 0.02, atol=1e-4)
    np.testing.assert_allclose(surge[water], STATE["surge"][water] + 0.1, atol=2e-3)


@pytest.mark.parametrize("later", [0.01, -0.01])
def test_velocities_of_one_ping_are_one_sample(later):
    """Water where it has it, else bottom, whichever comes first."""
    time = np.arange(10.0)
    lost = dict.fromkeys("xyz", np.where(time < 5.0, 1.3, np.nan))
    tables = {
        "WaterVelocity": MessageTable(time + later, lost),
        "GroundVelocity": MessageTable(time, dict.fromkeys("xyz", np.full(10, 1.1))),
    }
    found = _doppler(tables)
    assert found.columns["mode"].tolist() == [2.0] * 5 + [1.0] * 5
    assert found.columns["x"].tolist() == [1.3] * 5 + [1.1] * 5


def test_the_track_keeps_going_where_the_origin_moves(whole):
    dataset, _ = whole
    for axis, expected in zip(("north", "east"), track_of(TIME, STATE), strict=True):
        found = values(dataset, f"measured_onboard_{axis}")
        assert np.isfinite(found).all()
        away = (found - expected)[:-1]  # an import leaves out where a fix may correct it
        assert np.ptp(away) < 0.05, axis
    assert np.ptp(track_of(TIME, STATE)[0]) > 50.0


def test_one_sender_of_each_is_read_and_the_others_are_named(whole):
    _, report = whole
    names = report.names["IMC log"]
    assert {"Temperature/CTD", "Voltage/Batteries", "ServoPosition/2"} <= set(names["read"])
    unread = set(names["not read"])
    assert {"Temperature/Main_Board", "Voltage/Main_Board", "EulerAngles/AHRS"} <= unread
    assert "SetThrusterActuation" in unread  # a part of the power, no speed


def test_each_source_that_is_not_used_is_named_with_the_one_that_is(whole, tmp_path):
    def left_out(report):
        return {(e.subject, e.detail) for e in report.entries if "is taken from" in e.detail}

    angles = (("measured_roll", "phi"), ("measured_pitch", "theta"))
    taken = "{} is taken from EstimatedState/Navigation {}".format
    assert {("EulerAngles/AHRS", taken(*one)) for one in angles} <= left_out(whole[1])
    assert (
        "EstimatedState/Navigation",
        "measured_depth is taken from Depth/Depth_Sensor value",
    ) in left_out(whole[1])
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(
        'vehicle = "remus"\n[signals.measured_roll]\ncolumn = "EulerAngles/AHRS phi"\n'
        'unit = "rad"\n'
    )
    _, report = import_logs("lsf", [log(tmp_path)], mapping=mapping)
    assert {d for s, d in left_out(report) if s == "EulerAngles/AHRS"} == {
        "measured_pitch is taken from EstimatedState/Navigation theta",
        "measured_heading is taken from EstimatedState/Navigation psi",
    }


@pytest.mark.parametrize("order", ["<", ">"])
def test_packets_of_either_byte_order(order, tmp_path):
    """By the description alone; the little-endian ones are the very bytes that DUNE writes."""
    data = b""
    for moment in TIME.tolist():
        k = moment - TIME[0]
        attitude = (0.0, 0.1, -0.2, 0.5 + 0.001 * k, 0.4)
        data += described(order, 254, "5d", *attitude, moment=moment, entity=2)
        data += described(order, 265, "f", 2.5 + 0.01 * k, moment=moment, entity=3)
        data += described(order, 250, "h", -600, moment=moment, entity=6)
    path = tmp_path / "either.lsf"
    path.write_bytes(data)
    dataset, _ = import_logs("lsf", [path])
    since = TIME - TIME[0]
    np.testing.assert_allclose(values(dataset, "measured_roll"), np.degrees(0.1), atol=1e-4)
    np.testing.assert_allclose(values(dataset, "measured_pitch"), np.degrees(-0.2), atol=1e-4)
    heading = np.degrees(0.5 + 0.001 * since)
    np.testing.assert_allclose(values(dataset, "measured_heading"), heading, atol=1e-3)
    np.testing.assert_allclose(values(dataset, "measured_depth"), 2.5 + 0.01 * since, atol=1e-4)
    np.testing.assert_allclose(values(dataset, "measured_propeller"), -20.0 * np.pi, rtol=1e-6)
    if order == "<":
        own = message("Depth", float(TIME[0]), 3, value=2.5)
        assert own == described("<", 265, "f", 2.5, moment=float(TIME[0]), entity=3)


def test_a_packed_log_is_read_and_one_that_was_cut_to_its_end(tmp_path):
    whole = log(tmp_path)
    folder = tmp_path / "101530_lake"
    folder.mkdir()
    packed = folder / "Data.lsf.gz"
    packed.write_bytes(gzip.compress(whole.read_bytes()))
    (folder / "IMC.xml.gz").write_bytes(gzip.compress(b"<messages/>"))  # as DUNE leaves it there
    dataset, report = import_logs("lsf", [folder])
    assert report.deployments == ("101530_lake",)
    assert int(dataset["n_samples"][0]) == len(TIME)
    packed.write_bytes(packed.read_bytes()[: packed.stat().st_size * 3 // 4])
    shorter, report = import_logs("lsf", [packed])
    assert "truncated: unpacked up to" in said(report, "note", "Data.lsf.gz")
    assert 0.5 * len(TIME) < int(shorter["n_samples"][0]) < 0.9 * len(TIME)
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) * 3 // 4 + 7])
    _, report = import_logs("lsf", [whole])
    assert "truncated: " in said(report, "note", "run.lsf")
    assert report.hours == pytest.approx(90.0 / 3600.0, rel=0.02)


def test_damage_costs_no_more_than_the_packets_that_it_hits(tmp_path):
    every = packets(TIME, STATE)
    start = sum(map(len, every[:200]))
    depth = described("<", 265, "f", 99.0, moment=float(TIME[0]) + 0.1, entity=3)
    wrong_sum = depth[:-1] + bytes([depth[-1] ^ 1])
    unknown = described("<", 65_000, "3d", 1.0, 2.0, 3.0, moment=float(TIME[0]), entity=3)
    short = described("<", 254, "4d", 0.0, 1.0, 1.0, 1.0, moment=float(TIME[0]), entity=2)
    long = unknown[:4] + struct.pack("<H", 3000) + unknown[6:]  # its size would swallow many
    inserted = [wrong_sum, unknown, short, long]
    data = bytearray(b"".join([every[0], *inserted, *every[1:]]))
    place = start + sum(map(len, inserted))
    assert data[place : place + 2] == b"\x54\xfe"
    data[place : place + 30] = bytes(30)  # one packet lost with its header
    path = tmp_path / "run.lsf"
    path.write_bytes(bytes(data))
    dataset, report = import_logs("lsf", [path])
    assert int(dataset["n_samples"][0]) == len(TIME)
    assert values(dataset, "measured_depth").max() < 4.0
    assert said(report, "removed", "Depth") == "1 messages with invalid CRC"
    assert "too short" in said(report, "removed", "EulerAngles")
    lost = said(report, "removed", "run.lsf")
    assert lost.endswith("byte between packets: damaged")
    assert 30 <= int(lost.split()[0]) - len(long) <= 200
    assert said(report, "read", "Depth/Depth_Sensor value") == f"{len(TIME)} as measured_depth"
    state = said(report, "read", "EstimatedState/Navigation theta")
    assert state == f"{len(TIME) - 1} as measured_pitch"
    assert "message_65000/Depth_Sensor" in report.names["IMC log"]["not read"]


def test_what_another_system_sends_is_not_the_vehicles(tmp_path):
    path = log(tmp_path)
    others = b"".join(message("Depth", float(t), 3, OTHER, value=50.0) for t in TIME[:100])
    path.write_bytes(path.read_bytes() + entities(float(TIME[0]), OTHER) + others)
    dataset, report = import_logs("lsf", [path])
    assert values(dataset, "measured_depth").max() < 4.0
    assert said(report, "left out", "other systems") == "110 messages that they sent"


def test_a_compass_alone_needs_the_variation(tmp_path):
    """Without the filter the compass is read: one that says the same twice knows no true north."""
    data = b"".join(
        message("EulerAngles", float(t), 2, psi=1.0, psi_magnetic=1.0)
        + message("Depth", float(t), 3, value=3.0)
        for t in TIME
    )
    path = tmp_path / "run.lsf"
    path.write_bytes(data)
    refused("measured_heading is from magnetic north", "lsf", [path])
    dataset, _ = import_logs("lsf", [path], variation_deg=np.degrees(DECLINATION))
    heading = np.degrees(1.0 + DECLINATION)
    np.testing.assert_allclose(values(dataset, "measured_heading"), heading, atol=1e-3)


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.1), (0.0, 0.0, 9.8)])
def test_an_acceleration_that_is_no_specific_force_is_left_out(force, tmp_path):
    some = [
        message("Depth", float(t), 3, value=3.0)
        + message("Acceleration", float(t), 2, x=force[0], y=force[1], z=force[2])
        for t in TIME
    ]
    path = tmp_path / "run.lsf"
    path.write_bytes(b"".join(some))
    dataset, report = import_logs("lsf", [path])
    assert "measured_specific_force_z" not in dataset
    assert "without gravity, or z up" in said(report, "left out", "Acceleration/2")


def test_a_mapping_adds_other_messages_and_another_vehicle(tmp_path):
    mapping = tmp_path / "mine.toml"
    mapping.write_text(
        'vehicle = "lauv-test"\nmodel = "tethys"\nrows = "gaps"\n[signals]\n'
        'measured_temperature = { column = "Temperature/Main_Board value", unit = "degC" }\n'
        'measured_rudder = { column = "ServoPosition/1 value", unit = "rad", sign = -1 }\n'
        'commanded_propeller = { column = "DesiredSpeed value", unit = "rpm", optional = true }\n'
    )
    dataset, report = import_logs("lsf", [log(tmp_path)], mapping=mapping)
    assert report.rows == 1
    np.testing.assert_allclose(values(dataset, "measured_temperature"), 45.0, atol=1e-4)
    np.testing.assert_allclose(values(dataset, "measured_rudder"), np.degrees(0.05), atol=1e-4)
    np.testing.assert_allclose(values(dataset, "measured_elevator"), np.degrees(-0.06), atol=1e-4)
    assert dataset.attrs[VEHICLE_MJCF] == load_vehicle("tethys").xml
    mapping.write_text(mapping.read_text().replace("Main_Board value", "Main_Bord value"))
    refused(
        r"unknown topic 'Temperature/Main_Bord'.*Main_Board",
        "lsf",
        [log(tmp_path)],
        mapping=mapping,
    )
    mapping.write_text(mapping.read_text().replace("Main_Bord value", "Main_Board colour"))
    refused(
        "Temperature/Main_Board has no number 'colour'", "lsf", [log(tmp_path)], mapping=mapping
    )


def test_what_is_no_log_of_imc_is_told(tmp_path, capsys):
    path = tmp_path / "old.lsf"
    path.write_bytes(b"\x41\xfe" + bytes(200))
    refused(r"old\.lsf holds no packet of IMC 5: it begins with 41fe", "lsf", [path])
    path.write_bytes(struct.pack("<HHH", 0xFE54, 265, 60_000))
    assert PROGRAM.main(["import", "lsf", str(path), "--out", str(tmp_path / "no.zarr")]) != 0
    error = capsys.readouterr().err
    assert "old.lsf holds no packet of IMC 5" in error
    assert "Traceback" not in error
    path.write_bytes(message("Heartbeat", float(TIME[0]), 1))
    refused(r"no topic of it is known; it has Heartbeat", "lsf", [path])
    path.write_bytes(message("ServoPosition", float(TIME[0]), 7, id=0, value=0.1))
    refused("no topic of it is known; it has ServoPosition/0", "lsf", [path])


def test_a_store_of_it_is_one_that_identification_reads(tmp_path, capsys):
    """By the commands alone: log to store, and the runs of a vehicle under a propeller in it."""
    store = tmp_path / "real.zarr"
    assert PROGRAM.main(["import", "lsf", str(log(tmp_path)), "--out", str(store)]) == 0
    assert "EulerAngles/AHRS" in capsys.readouterr().out  # what was not read
    (run,) = load_runs(store, load_vehicle("remus"))
    assert not run.silent
    assert not run.commanded  # every part has its position
    assert np.isfinite(run.velocity[0]).mean() > 0.8
    assert set(run.ground[np.isfinite(run.velocity[0])]) == {True, False}
    assert run.use.any()
    names = load_vehicle("remus").part_names
    rudder = run.positions[:, names.index("rudder")]
    np.testing.assert_allclose(rudder, 0.12, atol=1e-5)
    spin = run.positions[:, names.index("propeller")]
    np.testing.assert_allclose(spin, np.round(STATE["rpm"]) * 2.0 * np.pi / 60.0, rtol=1e-5)


LAUV = SHARED / "auv_lauv_noptilus_2015"


@pytest.mark.skipif(not LAUV.is_dir(), reason="needs the shared log of a LAUV")
def test_a_real_log_beside_its_own_definition_of_imc():
    """A folder of DUNE: packed log and IMC.xml, 112 s at 3 m, with a Doppler log at 4.5 Hz."""
    dataset, report = import_logs("lsf", [LAUV])
    assert report.hours * 3600.0 == pytest.approx(112.0, abs=2.0)
    assert np.median(values(dataset, "measured_depth")) == pytest.approx(3.0, abs=0.5)
    assert "IMC.xml.gz" in said(report, "left out", "files")
    assert said(report, "read", "DVL x").startswith("471 ")
    surge, turns = values(dataset, "measured_dvl_surge"), values(dataset, "measured_propeller")
    assert np.nanmedian(surge) == pytest.approx(1.3, abs=0.1)
    assert np.nanmedian(turns) > 100.0
    assert {"measured_rudder", "measured_elevator", "measured_yaw_rate"} <= set(report.channels)
    assert not any("removed" in e.action and "CRC" in e.detail for e in report.entries)
