"""Rows that hold what no ocean and no vehicle allows: marked, told, and never called sound."""

import dataclasses

import numpy as np
import pytest
import zarr
from logs import refused, slocum

from factory.__main__ import PROGRAM
from factory.importing import IMPORTERS, Importer, import_logs
from factory.importing.cleaning import within_limits
from factory.importing.deployment_log import EMPTY, Channel, DeploymentLog, LoggedFixes
from factory.importing.dives import dive_store
from factory.importing.dives.dive_checks import keep_possible
from factory.importing.dives.dive_store import rows_of
from factory.importing.plausibility import DiveRules
from factory.importing.tally import Tally
from factory.samples import START, Flight
from factory.samples.gliders import slocum_columns, write_slocum
from factory.soundness import verify_logs
from twin.records import write_store
from twin.records.attributes import READER_VERSION
from twin.records.logged import LogStore
from twin.version import IMPORT_VERSION

FLIGHT = Flight()


def suspect(dataset):
    return [str(why) for why in dataset["suspect"].values]


def test_a_sound_log_has_no_suspect_row(tmp_path):
    dataset, _ = slocum(tmp_path, FLIGHT)
    assert suspect(dataset) == ["", "", ""]


def currents(tmp_path, **reported):
    """Why each of three dives is suspect whose vehicle reported these currents [m/s]."""
    ends = np.array([FLIGHT.dive_times(k)[1] + 60.0 for k in range(3)])
    log = dataclasses.replace(
        plain_log(), auxiliary={f"dac_{n}": Channel(ends, np.array(v)) for n, v in reported.items()}
    )
    tally = Tally()
    log = within_limits(log, tally)
    return whys(dataclasses.replace(log, doubts=tuple(tally.doubts)))


def rows_by(log):
    return rows_of(log, period=4.0, rules=DiveRules(), tally=Tally())[0]


def whys(log, **changes):
    """Why each row of a log is suspect."""
    return [row.suspect for row in rows_by(dataclasses.replace(log, **changes))]


def plain_log():
    """Three dives with depth, pitch and fixes."""
    time, state = FLIGHT.time, FLIGHT.state(FLIGHT.time)
    afloat = time[state["under"] == 0.0]
    return DeploymentLog(
        deployment="d",
        platform="p",
        channels={
            "measured_depth": Channel(time, state["depth"]),
            "measured_pitch": Channel(time, state["pitch"] + 0.1 * np.sin(time)),
        },
        fixes=LoggedFixes(afloat, *FLIGHT.position(afloat)),
        magnetic_variation=EMPTY,
        files=("d.csv",),
    )


def test_a_current_that_no_ocean_has_marks_its_own_dive(tmp_path):
    found = currents(tmp_path, north=[0.1, 3.2, 0.1], east=[0.2, 0.0, 2.9])
    assert [bool(why) for why in found] == [False, True, False]
    assert "a current of more than 3 m/s" in found[1]


def test_a_current_at_the_fix_between_two_dives_marks_the_one_before(tmp_path):
    ends = np.array([row.segment.end for row in rows_by(plain_log())])
    log = dataclasses.replace(
        plain_log(),
        auxiliary={
            f"dac_{axis}": Channel(ends, np.array([0.1, value, 0.1]))
            for axis, value in (("north", -999.0), ("east", 0.1))
        },
    )
    log = within_limits(log, tally := Tally())
    assert [bool(one) for one in whys(log, doubts=tuple(tally.doubts))] == [False, True, False]


def test_what_is_made_of_channels_is_within_limits_too():
    signals = {"measured_onboard_north": np.array([0.0, 2e7]), "measured_pitch": np.ones(2)}
    ((name, why),) = keep_possible(signals)
    assert name == "measured_onboard_north"
    assert "removed" in why
    np.testing.assert_array_equal(signals[name], [0.0, np.nan])


def test_a_current_that_is_no_number_of_an_ocean_reaches_no_store(tmp_path):
    log = dataclasses.replace(
        plain_log(), auxiliary={"dac_north": Channel(np.array([START]), np.array([1e308]))}
    )
    assert not len(within_limits(log, Tally()).channel("dac_north"))


@pytest.mark.parametrize("name", ["measured_pump", "measured_rotation", "commanded_shift"])
@pytest.mark.parametrize("value", [5e14, -1e308, np.inf])
def test_a_value_beyond_any_vehicle_never_reaches_a_store(name, value):
    log = plain_log()
    values = np.where(np.arange(len(FLIGHT.time)) % 50 == 7, value, 1.0)
    log = dataclasses.replace(
        log, channels={**log.channels, name: Channel(FLIGHT.time, values)}
    )  # fmt: skip
    tally = Tally()
    kept = within_limits(log, tally).channel(name)
    assert np.array_equal(np.unique(kept.values), [1.0])
    (entry,) = [e for e in tally.entries() if e.subject == name]
    assert (entry.action, entry.count) == ("removed", int((values != 1.0).sum()))
    assert not tally.doubts


def test_a_channel_that_is_nearly_always_impossible_is_doubted():
    log = plain_log()
    kelvin = Channel(FLIGHT.time, 281.0 + 0.01 * np.arange(len(FLIGHT.time)))
    off = Channel(FLIGHT.time, np.full(len(FLIGHT.time), -999.0))
    for channel, doubts in ((kelvin, 1), (off, 0)):
        tally = Tally()
        other = dataclasses.replace(
            log, channels={**log.channels, "measured_temperature": channel}
        )  # fmt: skip
        within_limits(other, tally)
        assert len(tally.doubts) == doubts


def test_a_pitch_that_cannot_make_the_sinking_is_suspect(tmp_path):
    radian = np.radians(FLIGHT.state(FLIGHT.time)["pitch"])
    log = plain_log()
    channels = {**log.channels, "measured_pitch": Channel(FLIGHT.time, radian)}
    assert all("measured_pitch: below 2 degree" in one for one in whys(log, channels=channels))


def test_fixes_far_from_the_waypoint_and_from_the_own_track_are_suspect():
    log = plain_log()
    far = LoggedFixes(log.fixes.time, log.fixes.latitude / 60.0, log.fixes.longitude)
    names = ("latitude", "longitude")
    track = FLIGHT.position(FLIGHT.time)
    here = {n: Channel(FLIGHT.time, one) for n, one in zip(names, track, strict=True)}
    sent = {f"waypoint_{name}": channel for name, channel in here.items()}
    for auxiliary, what in ((here, "its own track"), (sent, "its waypoint")):
        found = whys(log, fixes=far, auxiliary=auxiliary)
        assert all(f"more than 1000 km from {what}" in one for one in found)
        assert not any(whys(log, auxiliary=auxiliary))


def test_a_doubt_of_a_reader_marks_the_rows_of_its_time_alone():
    log = plain_log()
    tally = Tally()
    start, end = FLIGHT.dive_times(1)
    tally.doubt("measured_depth", "two sensors disagree", deployment="d", start=start, end=end)
    found = whys(log, doubts=tuple(tally.doubts))
    assert found == ["", "measured_depth: two sensors disagree", ""]


def test_a_store_with_a_suspect_row_is_not_sound(tmp_path, capsys):
    columns = slocum_columns(FLIGHT)
    write_slocum(tmp_path, FLIGHT, m_pitch=-columns["m_pitch"])  # sinks nose up
    out = tmp_path / "log.zarr"
    assert PROGRAM.main(["import", "slocum", str(tmp_path), "--out", str(out)]) == 0
    assert "3 of 3 rows suspect" in capsys.readouterr().err
    with LogStore(out) as logs:
        (check,) = [c for c in verify_logs(logs).checks if c.name == "suspect"]
        assert len(check.problems) == 3
    assert PROGRAM.main(["verify", str(out)]) == 1
    said = capsys.readouterr().out
    assert "sinks nose up" in said
    assert "NOT sound" in said


def test_a_log_of_older_readers_says_so_wherever_it_is_opened(tmp_path):
    dataset, _ = slocum(tmp_path, FLIGHT)
    path = write_store(dataset, tmp_path / "log.zarr")
    LogStore(path).close()  # no warning
    assert dataset.attrs[READER_VERSION] == IMPORT_VERSION
    older = {k: v for k, v in dataset.attrs.items() if k != READER_VERSION}
    path = write_store(dataset.drop_vars("suspect").assign_attrs(older), tmp_path / "old.zarr")
    del zarr.open_group(path, mode="r+").attrs[READER_VERSION]
    with pytest.warns(UserWarning, match="imported by version 1 of the readers"):
        logs = LogStore(path)
    assert logs.suspect == ["", "", ""]


def fails_at(*names):
    """A reader that fails in its last stage when files of these names are among the given."""

    def read(paths, options, tally):
        tally.add("read", "rows", len(paths))
        if {path.name for path in paths} >= set(names):
            raise ZeroDivisionError("of a name")
        return [dataclasses.replace(plain_log(), files=tuple(path.name for path in paths))]

    return read


@pytest.fixture
def odd(tmp_path):
    """Import three files by a reader that fails at some names."""
    paths = [tmp_path / f"{letter}.odd" for letter in "abc"]
    for number, path in enumerate(paths):
        path.write_text(str(number))

    def bring(*names):
        IMPORTERS.add(
            Importer(
                name="odd", vehicle="v", files="f", channels="c", suffixes=frozenset({".odd"}),
                marks=frozenset({"odd"}), period=4.0, read=fails_at(*names),
            )
        )  # fmt: skip
        return import_logs("odd", paths)

    yield bring
    IMPORTERS.unregister("odd")


def test_a_file_at_which_a_reader_fails_late_is_left_out_by_name(odd):
    dataset, report = odd("b.odd")
    assert dataset.sizes["mission"] == 3
    assert report.files == ("a.odd", "c.odd")
    (lost,) = [e for e in report.entries if e.subject == "unreadable file"]
    assert "b.odd" in lost.detail
    assert "ZeroDivisionError: of a name" in lost.detail
    assert report.count("read", "rows") == 2  # the failed try counts nothing


def test_files_at_which_a_reader_fails_together_are_told(odd):
    refused(r"fails at them together.*ZeroDivisionError", "a.odd", "b.odd", by=odd)


def test_a_deployment_that_cannot_be_cut_leaves_the_others(monkeypatch):
    cut = dive_store.cut

    def failing(log, *args):
        return cut(log, *args) if log.deployment == "d" else [][0]

    monkeypatch.setattr(dive_store, "cut", failing)
    bad = dataclasses.replace(plain_log(), deployment="bad", files=("bad.csv",))
    options = {"kind": "csv", "period": 4.0, "rules": DiveRules(), "files": ["f"]}
    dataset, report = dive_store.build([bad, plain_log()], tally=Tally(), **options)
    assert dataset.sizes["mission"] == 3
    (lost,) = [e for e in report.entries if e.subject == "unreadable file"]
    assert "bad (bad.csv) holds what cannot be cut into dives: IndexError" in lost.detail
    refused(r"bad \(bad.csv\)", [bad], tally=Tally(), **options, by=dive_store.build)
