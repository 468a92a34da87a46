"""Arrivals: whatever comes into a source and in whatever order, the log is the import of the files.

Damage of a deployment's folder, which the next pass mends.
"""

import json
import os
import random
import shutil
from pathlib import Path

import numpy as np
import pd0_files
import pytest
import xarray as xr

from factory.importing import import_logs
from factory.samples import START, Flight, write_csv
from factory.samples.gliders import (
    gps_columns,
    gps_sensors,
    slocum_columns,
    write_basestation,
    write_dbd,
)
from glider_twin_ops.pages.morning_page import PAGE
from glider_twin_ops.watching import WatchedDeployment, one_pass, watch_pass
from glider_twin_ops.watching.arrived_files import kind_of
from glider_twin_ops.watching.log_of_files import DIGEST, LOG, content_of, log_of_files
from glider_twin_ops.watching.watch_pass import BELIEFS, EVENTS, noticed, write_events
from twin.__main__ import PROGRAM
from twin.errors import WriteError
from twin.records import write_store
from twin.records.attributes import DEPLOYMENT_METADATA, HISTORY

pytestmark = pytest.mark.usefixtures("no_figures")
FLIGHT = Flight(dives=4)
LIST, SCIENCE_LIST = "0badcafe", "0badbeef"
HALF, WRONG, ABSENT, BETWEEN = 0.3, 0.2, 0.1, 0.4
"""Probabilities that a file comes by halves, with wrong content or not at all first, and of a pass
before the next one"""


def write_segments(folder):
    """Satellite files of a Slocum: .sbd and .tbd of each dive, and their two lists of sensors.

    The vehicle's own pressure is noisy in the first two dives and the CTD's in all, so that single
    dives would choose another sensor than all of them do. The second .sbd lists its sensors itself.
    """
    draw = np.random.default_rng(0)
    gps, flown = gps_columns(FLIGHT), slocum_columns(FLIGHT)
    time = flown.pop("time")
    deep = FLIGHT.state(time)["depth"] * 1.0065 / 10.0
    early = time < START + 2.0 * FLIGHT.cycle
    flown["m_pressure"] = deep + np.where(early, 0.05, 0.002) * draw.standard_normal(len(time))
    science = {"sci_water_pressure": deep + 0.035 * draw.standard_normal(len(time))}
    science["sci_water_temp"] = 15.0 - 0.1 * deep
    science["sci_water_cond"] = 3.9 - 0.01 * deep
    found = []
    for dive in range(FLIGHT.dives):
        begin, end = FLIGHT.dive_times(dive)
        inside = (time >= begin - 140.0) & (time < end + 140.0)
        for ending, clock, crc, columns, whole in (
            ("sbd", "m_present_time", LIST, flown, gps_sensors(gps)),
            ("tbd", "sci_m_present_time", SCIENCE_LIST, science, {}),
        ):
            some = {clock: time[inside]}
            some |= {name: values[inside] for name, values in columns.items()}
            made, _ = write_dbd(
                folder, FLIGHT, "unit_1", columns=some | whole, crc=crc,
                factored=not (ending == "sbd" and dive == 1),
            )  # fmt: skip
            found.append(made.rename(folder / f"unit_1-2023-317-0-{dive}.{ending}"))
    return [*found, folder / f"{LIST}.cac", folder / f"{SCIENCE_LIST}.cac"]


@pytest.fixture(scope="module")
def segments(tmp_path_factory):
    pytest.importorskip("dbdreader")
    return write_segments(tmp_path_factory.mktemp("segments"))


def stored(path):
    """A store less what says when and from where it was made."""
    found = xr.open_zarr(path, decode_times=False).load()
    found.attrs = {k: v for k, v in found.attrs.items() if k not in (HISTORY, DIGEST)}
    return found


def imported(place, kind, source, **options):
    dataset, _ = import_logs(kind, [source], **options)
    return stored(write_store(dataset, place / "imported.zarr", overwrite=True))


def misspelt(path):
    """A list of sensors in which pitch has another name."""
    return path.read_bytes().replace(b" m_pitch ", b" m_pitcx ")


# --- the log is the import ------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_log_is_the_import_of_the_same_files_whatever_came_first(
    tmp_path, watched, source, segments, seed
):
    draw = random.Random(seed)
    made = watched()
    for path in draw.sample(segments, len(segments)):
        right, target = path.read_bytes(), source / path.name
        firsts = []
        if draw.random() < HALF:
            firsts.append(right[: draw.randrange(len(right))])
        if draw.random() < WRONG:
            firsts.append(draw.choice(segments).read_bytes())
        if path.suffix == ".cac":
            firsts.append(misspelt(path))
        for content in firsts:
            target.write_bytes(content)
            log_of_files(made, made.folder)
        if draw.random() < ABSENT:
            target.unlink(missing_ok=True)
            log_of_files(made, made.folder)
        target.write_bytes(right)
        shutil.copy(path, source / f".{path.name}.part")
        if path.suffix != ".cac":
            shutil.copy(path, source / f"copy of {path.name}")
        if draw.random() < BETWEEN:
            log_of_files(made, made.folder)
    found = log_of_files(made, made.folder)
    assert found.unreadable == ()
    wanted = imported(tmp_path, "slocum", segments[0].parent)
    assert wanted.sizes["mission"] == FLIGHT.dives
    assert "from m_pressure" in wanted.attrs["import_report"]
    xr.testing.assert_identical(stored(made.folder / LOG), wanted)
    assert not log_of_files(made, made.folder).changed


def _beside(source, path, right):
    (source / path.name).write_bytes(path.read_bytes() if right else misspelt(path))


def _in_cache(source, path, right):
    cache = source.parent / "lists"
    cache.mkdir(exist_ok=True)
    _beside(cache, path, right)


def _in_another_log(source, path, right):
    log = path.with_name("unit_1-2023-317-0-1.sbd")
    content = log.read_bytes()
    (source / log.name).write_bytes(content if right else content.replace(b"m_pitch ", b"m_pitcx "))


@pytest.mark.parametrize("put", [_beside, _in_cache, _in_another_log])
def test_a_corrected_list_of_sensors_makes_the_log_again(tmp_path, watched, source, segments, put):
    chosen = [one for one in segments if one.name != "unit_1-2023-317-0-1.sbd"]
    for path in chosen:
        if path.stem != LIST:
            shutil.copy(path, source)
    (path,) = (one for one in segments if one.stem == LIST)
    put(source, path, False)
    cache = source.parent / "lists"
    options = {"cache": cache} if put is _in_cache else {}
    made = watched(cache=str(cache) if options else "")
    log_of_files(made, made.folder)
    assert "measured_pitch" not in stored(made.folder / LOG)
    put(source, path, True)
    assert log_of_files(made, made.folder).changed
    found = stored(made.folder / LOG)
    assert np.nanmax(found["measured_pitch"]) == pytest.approx(FLIGHT.pitch, abs=0.1)
    xr.testing.assert_identical(found, imported(tmp_path, "slocum", source, **options))


def test_lists_beside_the_files_count_with_those_of_a_cache_folder(
    tmp_path, watched, source, segments
):
    (tmp_path / "lists").mkdir()
    for path in segments:
        shutil.copy(path, tmp_path / "lists" if path.stem == SCIENCE_LIST else source)
    made = watched(cache=str(tmp_path / "lists"))
    assert log_of_files(made, made.folder).unreadable == ()
    assert {"measured_pitch", "measured_temperature"} <= {*stored(made.folder / LOG)}


def test_what_a_mapping_and_a_text_beside_say_belongs_to_the_log(tmp_path, watched, source):
    state = FLIGHT.state(FLIGHT.time)
    write_csv(
        source / "a.csv",
        {"t": FLIGHT.time, "z": state["depth"], "p": state["pitch"], "q": 0.5 * state["pitch"]},
    )
    mapping = tmp_path / "mine.toml"
    words = """
        vehicle = "mine"
        [time]
        column = "t"
        unit = "s"
        [signals]
        measured_depth = {{ column = "z", unit = "m" }}
        measured_pitch = {{ column = "{}", unit = "deg" }}
        """
    mapping.write_text(words.format("q"))
    made = watched(kind="csv", mapping=str(mapping))
    assert log_of_files(made, made.folder).changed
    mapping.write_text(words.format("p"))
    assert log_of_files(made, made.folder).changed
    found = stored(made.folder / LOG)
    assert np.nanmax(found["measured_pitch"]) == pytest.approx(FLIGHT.pitch, abs=1e-3)
    (source / "metadata.yml").write_text("glider_name: calypso\n")
    assert log_of_files(made, made.folder).changed
    found = stored(made.folder / LOG)
    assert found.attrs[DEPLOYMENT_METADATA] == "glider_name: calypso\n"
    xr.testing.assert_identical(found, imported(tmp_path, "csv", source, mapping=mapping))
    assert not log_of_files(made, made.folder).changed


# --- files that no reader can read ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("was", "becomes", "why"),
    [
        (b"total_num_sensors: 13", b"total_num_sensors: 1!3", "total_num_sensors is '1!3'"),
        (b"num_ascii_tags: 14", b"num_ascii_tags: 1.", "num_ascii_tags is '1.'"),
        (b"sensors_per_cycle: 13", b"sensors_per_cycle: -3", "sensors_per_cycle is '-3'"),
        (b"sensor_list_crc: 0bad", b"sensor_list_crc: \x00bad", ""),
    ],
)
def test_a_file_with_a_changed_byte_is_named_and_left_out(
    watched, source, segments, was, becomes, why
):
    for path in segments:
        shutil.copy(path, source)
    made = watched()
    path = source / "unit_1-2023-317-0-3.sbd"
    content = path.read_bytes()
    assert was in content
    path.write_bytes(content.replace(was, becomes))
    found = log_of_files(made, made.folder)
    assert any(path.name in said and why in said for said in found.unreadable), found
    assert found.files == len(segments) - 3
    path.write_bytes(content)
    assert log_of_files(made, made.folder).unreadable == ()


def test_names_that_are_no_text_and_what_is_no_file_stop_no_pass(
    tmp_path, watched, source, segments
):
    for path in segments:
        shutil.copy(path, source)
    odd = os.fsencode(source) + b"/unit_1-2023-317-0-\xff.sbd"
    (source / "unit_1-2023-317-0-0.sbd").rename(os.fsdecode(odd))
    os.mkfifo(source / "a.sbd")
    (source / "b.sbd").symlink_to("/dev/zero")
    (source / "c.sbd").symlink_to(source / "nowhere")
    (source / "d.sbd").mkdir()
    (source / "metadata.yml").mkdir()
    made = watched()
    found = log_of_files(made, made.folder)
    assert found.changed, found
    for said in found.unreadable:
        said.encode()
    write_events(noticed(found, None), made.folder)
    assert not log_of_files(made, made.folder).changed
    source.rename(tmp_path / "elsewhere")
    assert "is not there" in log_of_files(made, made.folder).missing


def test_a_lone_science_file_of_another_vehicle_hides_no_log(watched, source, segments):
    for path in segments:
        shutil.copy(path, source)
    stray = (source / "unit_1-2023-317-0-0.tbd").read_bytes()
    stray = stray.replace(b"unit_1-2023", b"unix_1-2023").replace(b"_pressure", b"_pressurx")
    (source / "zzz.tbd").write_bytes(stray.replace(SCIENCE_LIST.encode(), b"0badf00d"))
    lines = (source / f"{SCIENCE_LIST}.cac").read_bytes().replace(b"_pressure", b"_pressurx")
    (source / "0badf00d.cac").write_bytes(lines)
    made = watched()
    found = log_of_files(made, made.folder)
    assert len(stored(made.folder / LOG)["mission"]) == FLIGHT.dives
    assert any("zzz.tbd" in said and "neither depth nor pressure" in said
               for said in found.unreadable), found  # fmt: skip


def test_watching_goes_on_after_a_pass_that_fails(watched, segments, monkeypatch, capsys):
    made = watched()
    errors = [RuntimeError("a merge\nthat fails"), MemoryError(), WriteError("no room"), None]

    def passed(*_, **__):
        if (error := errors.pop(0)) is not None:
            raise error
        raise KeyboardInterrupt

    monkeypatch.setattr("glider_twin_ops.watching.one_pass", passed)
    monkeypatch.setattr("time.sleep", lambda _: None)
    assert PROGRAM.main(["watch", str(made.folder)]) == 130
    said = capsys.readouterr().err
    for words in ("RuntimeError: a merge", "MemoryError", "no room"):
        (line,) = (one for one in said.splitlines() if words in one)
        assert line.endswith("the next look tries again")
    assert "Traceback" not in said


def test_a_server_that_answers_nonsense_is_named(tmp_path, monkeypatch):
    def fetch(*_):
        raise KeyError("no such column")

    monkeypatch.setattr("glider_twin_ops.watching.sources.fetch_days", fetch)
    made = WatchedDeployment(
        folder=tmp_path, source="https://data.example.org/erddap/tabledap/calypso"
    )
    found = log_of_files(made, made.folder)
    assert any("KeyError" in said for said in found.unreadable)


# --- damage of what is kept -----------------------------------------------------------------------


def _cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))


def _nest(path):
    path.write_text("[" * 100_000)


KEPT = (
    f"{LOG}/zarr.json", f"{LOG}/checksums/zarr.json", f"{LOG}/measured_depth/c/0/0",
    f"{BELIEFS}/zarr.json", f"{BELIEFS}/checksums/zarr.json", f"{BELIEFS}/level/c/0/0",
    EVENTS, f"{PAGE}/index.html", f"{PAGE}/latest.json", f"{PAGE}/summary.txt",
    f"{PAGE}/checksums.json",
)  # fmt: skip


@pytest.fixture(scope="module")
def passed(tmp_path_factory, deployment):
    """A deployment after a pass, what it told, and the sums of its parts."""
    place = tmp_path_factory.mktemp("passed")
    files = write_basestation(place, Flight(dives=3))
    (place / "arrived").mkdir()
    for path in files:
        path.rename(place / "arrived" / path.name)
    (place / "arrived" / "p9990001.nc").write_bytes(b"junk")  # so that there is an event
    made = deployment(place, place / "arrived", vehicle="seaglider")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
        told = one_pass(made).told
        assert one_pass(made).changed is False
    made_of = {name: content_of(made.folder / name) for name in (LOG, BELIEFS, EVENTS, PAGE)}
    assert all(made_of.values())
    assert json.loads((made.folder / EVENTS).read_text())["event"] == "unreadable file"
    return made, made_of, told


@pytest.fixture
def again(passed, monkeypatch):
    """A pass, to be spoilt, and the sums; what later passes tell is as the first one had it."""
    made, sums, told = passed
    monkeypatch.setattr(watch_pass, "morning", lambda *_, **__: told)
    return made, sums


def assert_made_again(made, sums):
    one_pass(made)
    assert {part: content_of(made.folder / part) for part in sums} == sums
    assert not one_pass(made).changed


@pytest.mark.parametrize("harm", [_cut, _flip, Path.unlink, _nest])
@pytest.mark.parametrize("name", KEPT)
def test_a_part_that_is_not_as_it_was_written_is_made_again(again, name, harm):
    made, sums = again
    harm(made.folder / name)
    assert content_of(made.folder / name.partition("/")[0]) != sums[name.partition("/")[0]]
    assert_made_again(made, sums)


@pytest.mark.parametrize("name", [LOG, BELIEFS, PAGE])
def test_a_part_that_is_gone_is_made_again(again, name):
    made, sums = again
    shutil.rmtree(made.folder / name)
    assert_made_again(made, sums)


def test_a_doppler_logs_files_do_not_hide_their_vehicle(watched, source):
    pd0_files.write(source / "A.PD0", pd0_files.yo(3))
    made = watched(kind="auto")
    assert kind_of(made) == "pd0"
    write_basestation(source, Flight(dives=1))
    assert kind_of(made) == "seaglider"
