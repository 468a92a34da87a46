"""Import of a Slocum's binary files: compressed, unclosed, cut, undecodable, among others."""

import numpy as np
import pytest
from logs import pack, refused

from factory.importing import import_logs
from factory.importing.angles import reference_declination
from factory.importing.deployment_log import LoggedFixes
from factory.importing.tally import Tally
from factory.samples import Flight
from factory.samples.gliders import gps_columns, write_dbd, write_seaexplorer
from twin.errors import InputError
from twin.records.coordinates import utc_minute

FLIGHT = Flight()
pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def dbd(tmp_path):
    pytest.importorskip("dbdreader")
    return write_dbd(tmp_path, FLIGHT)[0]


def test_compressed_files_are_those_that_they_were(dbd, tmp_path):
    right, _ = import_logs("slocum", [dbd])
    packed = tmp_path / "packed"
    packed.mkdir()
    (packed / "01230000.dcd").write_bytes(pack(dbd.read_bytes()))
    (packed / "0badcafe.ccc").write_bytes(pack((tmp_path / "0badcafe.cac").read_bytes()))
    dataset, report = import_logs("slocum", [packed])
    assert report.deployments == ("unit1",)  # by what is in it, not by the file's name
    assert report.files == ("01230000.dcd",)
    for name in report.channels:
        assert np.array_equal(dataset[name], right[name], equal_nan=True), name
    assert not [e for e in report.entries if "truncated" in e.detail]


def test_a_compressed_file_that_is_cut_is_read_up_to_there(dbd, tmp_path):
    cut = tmp_path / "01230000.dcd"
    whole = pack(dbd.read_bytes())
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    dbd.unlink()
    dataset, report = import_logs("slocum", [tmp_path])
    assert 1 <= report.rows < FLIGHT.dives
    assert [e.subject for e in report.entries if "truncated" in e.detail] == [cut.name]
    assert "measured_pitch" in dataset
    cut.write_bytes(whole[:40])
    refused(r"01230000\.dcd .*cut in its first block", "slocum", [cut])


def test_a_file_without_the_closing_byte_is_whole_when_its_last_cycle_is(dbd):
    whole = dbd.read_bytes()
    right, _ = import_logs("slocum", [dbd])
    assert whole.endswith(b"X")
    dbd.write_bytes(whole[:-1])  # as newer software ends
    dataset, report = import_logs("slocum", [dbd])
    assert not [e for e in report.entries if "truncated" in e.detail]
    assert np.array_equal(dataset["measured_depth"], right["measured_depth"], equal_nan=True)
    dbd.write_bytes(whole[:-4])
    _, report = import_logs("slocum", [dbd])
    (said,) = [e for e in report.entries if "truncated" in e.detail]
    assert said.subject == dbd.name
    assert said.detail == f"truncated: goes to {utc_minute(FLIGHT.time[-2])} UTC"


def test_of_files_that_cannot_be_read_every_reason_is_said_once(dbd):
    (dbd.parent / "0badcafe.cac").unlink()
    (dbd.parent / "aaa.dbd").write_bytes(b"junk")
    (dbd.parent / "bbb.dbd").write_bytes(dbd.read_bytes() + b"X")
    with pytest.raises(InputError) as told:
        import_logs("slocum", [dbd.parent])
    for words in ("aaa.dbd is not a Slocum", "2 of 3 files: cache file 0badcafe.cac is missing"):
        assert str(told.value).count(words) == 1, told.value


def test_one_bad_file_is_left_out_and_told(dbd, tmp_path):
    right, _ = import_logs("slocum", [dbd])
    bad = {
        "a.dbd": b"",
        "b.dbd": b"no header of any Slocum\n" * 20,
        "c.dbd": dbd.read_bytes().replace(b"0badcafe", b"11111111"),
        "d.dbd": dbd.read_bytes()[:150],
        "e.ecd": b"\x00\x10" + bytes(range(16)),
        "sea.0.evt": b"12/07/2018 20:53:02\t3\tKey=q\n",
    }
    for name, content in bad.items():
        (tmp_path / name).write_bytes(content)
    write_seaexplorer(tmp_path / "sea009_M3_gli.csv", Flight(depth=50.0))  # another vehicle's
    dataset, report = import_logs("slocum", [tmp_path])
    told = [e.detail for e in report.entries if e.subject.endswith(("unreadable file", "kind"))]
    assert len(told) == 6
    refused(
        r"^5 files cannot be read, half or more: .*keep-going",
        "slocum",
        [tmp_path],
        keep_going=False,
    )
    for name in ("a.dbd", "b.dbd", "c.dbd", "d.dbd", "e.ecd", "sea009_M3_gli.csv"):
        assert sum(name in line for line in told) == 1, name
    assert report.files == (dbd.name,)
    assert np.array_equal(dataset["measured_depth"], right["measured_depth"], equal_nan=True)
    # alone, each is refused with its own reason
    for name in ("a.dbd", "b.dbd", "c.dbd", "d.dbd", "e.ecd"):
        refused(name, "slocum", [tmp_path / name])


def test_half_of_the_files_unreadable_is_a_failure(dbd, tmp_path):
    (tmp_path / "a.dbd").write_bytes(b"no header of any Slocum\n" * 20)
    refused(r"^1 files cannot be read, half or more", "slocum", [tmp_path], keep_going=False)
    assert import_logs("slocum", [tmp_path])[1].files == (dbd.name,)


def test_files_with_the_same_reason_are_told_once(dbd, tmp_path):
    caches = tmp_path.parent / "caches"
    caches.mkdir(exist_ok=True)
    (caches / "11111111.cac").write_text("")
    for name in "abc":
        content = dbd.read_bytes().replace(b"0badcafe", b"11111111")
        (tmp_path / f"{name}.dbd").write_bytes(content)
    _, report = import_logs("slocum", [tmp_path])
    (told,) = (e for e in report.entries if e.subject == "unreadable file")
    assert told.count == 3
    assert told.detail.startswith("3 of 4 files: cache file 11111111.cac is missing")
    assert f"--cache {caches}" in told.detail


@pytest.mark.parametrize("compressed", [False, True])
def test_a_log_that_lists_its_sensors_makes_the_cache_of_the_others(dbd, tmp_path, compressed):
    """Whatever its place among them: here the last by name."""
    right, _ = import_logs("slocum", [dbd])
    other = tmp_path / "other"
    other.mkdir()
    whole = write_dbd(other, FLIGHT, factored=False)[0].read_bytes()
    folder = tmp_path / "satellite"
    folder.mkdir()
    (folder / "a.dbd").write_bytes(dbd.read_bytes())
    name, content = ("z.dcd", pack(whole)) if compressed else ("z.dbd", whole)
    (folder / name).write_bytes(content)
    dataset, report = import_logs("slocum", [folder])
    assert report.files == ("a.dbd", name)
    assert not [e for e in report.entries if e.subject == "unreadable file"]
    assert np.array_equal(dataset["measured_pitch"], right["measured_pitch"], equal_nan=True)
    # one that is not imported gives its list too: in the folder of caches
    alone = tmp_path / "alone"
    alone.mkdir()
    (alone / "a.dbd").write_bytes(dbd.read_bytes())
    _, report = import_logs("slocum", [alone], cache=folder)
    assert report.files == ("a.dbd",)


def test_a_list_of_sensors_that_is_cut_or_anothers_is_told(dbd, tmp_path):
    dbd.with_name("0badcafe.cac").unlink()
    folder = tmp_path / "satellite"
    folder.mkdir()
    whole = write_dbd(folder, FLIGHT, factored=False)[0].read_bytes()
    for path in folder.iterdir():
        path.unlink()
    cut = folder / "cut.dbd"
    cut.write_bytes(whole[: whole.index(b"s: T 5 ") + 3])
    refused(r"cut\.dbd is truncated within its list of sensors: 5 of", "slocum", [cut])
    short = write_dbd(tmp_path / "satellite", FLIGHT, without=("m_pitch",), factored=False)[0]
    (folder / "0badcafe.cac").unlink()
    cut.write_bytes(dbd.read_bytes())
    refused(rf"{short.name} is not the one of cut\.dbd: it lists", "slocum", [cut])


def test_science_and_flight_of_one_vehicle_are_joined_whatever_their_names(dbd, tmp_path):
    """A vehicle numbers its files 01230000; who they are of stands inside."""
    state = FLIGHT.state(FLIGHT.time + 1.0)
    water = {
        "sci_water_temp": 8.0 + 0.01 * state["depth"],
        "sci_water_cond": np.full(len(FLIGHT.time), 3.4),
        "sci_water_pressure": state["depth"] * 1.0065 / 10.0,
    }
    folder = tmp_path / "offload"
    folder.mkdir()
    (folder / "01230000.dcd").write_bytes(pack(dbd.read_bytes()))
    (folder / "0badcafe.cac").write_bytes((tmp_path / "0badcafe.cac").read_bytes())
    science, cache = write_dbd(
        tmp_path, FLIGHT, columns={"sci_m_present_time": FLIGHT.time + 1.0, **water}, crc="5c1e0ce5"
    )
    (folder / "01230000.ecd").write_bytes(pack(science.read_bytes()))
    (folder / "5c1e0ce5.cac").write_bytes(cache.read_bytes())
    dataset, report = import_logs("slocum", [folder])
    assert report.deployments == ("unit1",)
    deep = dataset["measured_depth"].values > 10.0
    warm = dataset["measured_temperature"].values[deep]
    assert np.allclose(warm, 8.0 + 0.01 * dataset["measured_depth"].values[deep], atol=0.02)
    assert {"measured_salinity", "measured_density", "measured_pitch"} <= set(report.channels)


def test_a_log_without_variation_takes_that_of_its_place_and_date(tmp_path):
    pytest.importorskip("dbdreader")
    gps = gps_columns(FLIGHT)
    del gps["mag_var_rad"]
    path, _ = write_dbd(tmp_path, FLIGHT, without=("m_gps_mag_var",))
    dataset, report = import_logs("slocum", [path])
    assert dataset["magnetic_variation"].values == pytest.approx(-18.05, abs=0.1)
    turned = FLIGHT.heading - FLIGHT.variation - 18.05
    assert np.nanmedian(dataset["measured_heading"]) == pytest.approx(turned, abs=0.1)
    notes = [e.detail for e in report.entries if e.subject == "magnetic variation"]
    assert len(notes) == 1
    assert "by IGRF-14 at its place and date" in notes[0]


@pytest.mark.parametrize(
    ("day", "latitude", "longitude", "logged"),
    [
        ("2023-06-01", 46.90, -124.90, 15.5),  # SG236
        ("2024-05-27", 12.11, 85.89, -1.2),  # SG171
    ],
)
def test_the_reference_field_agrees_with_base_stations(day, latitude, longitude, logged):
    """What Seagliders' base stations put into their files, to a tenth of a degree."""
    time = np.array([np.datetime64(day, "s").astype(float)])
    place = LoggedFixes(time, np.array([latitude]), np.array([longitude]))
    found = reference_declination(place, "log", Tally())
    assert found.values == pytest.approx([logged], abs=0.1)


def test_no_place_no_reference_field():
    nothing = np.zeros(0)
    assert not len(reference_declination(LoggedFixes(nothing, nothing, nothing), "log", Tally()))
