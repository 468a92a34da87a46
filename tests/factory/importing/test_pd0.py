"""PD0 files that the test writes: axes, tilt, screens, clocks, damage, and what real ones hold."""

import dataclasses
import tempfile
from pathlib import Path

import gsw
import numpy as np
import pd0_files
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs import SHARED, values

from factory import samples
from factory.__main__ import PROGRAM
from factory.importing import Channel, import_logs, sniff
from factory.importing.deployment_log import EMPTY, NO_FIXES, DeploymentLog
from factory.importing.doppler.hull_velocity import hull_velocity
from factory.importing.doppler.pd0 import read_pd0
from factory.importing.doppler.relative_velocity import relative_velocity
from factory.importing.doppler.screens import Thresholds
from factory.samples import Flight
from twin.errors import InputError
from twin.frames import euler_to_matrix

U, V, W = (f"measured_dvl_{axis}" for axis in ("surge", "sway", "heave"))
MOVES = np.array([0.51, 0.13, -0.07])
"""[m/s] A velocity with another number and sign on each axis"""


def number(file):
    """Ensembles of a file."""
    return sum(len(one["time"]) for one in file.layouts)


def words(report, subject="Doppler log"):
    return "\n".join(
        f"{e.action} {e.count} {e.detail}" for e in report.entries if e.subject == subject
    )


def refused(*args, **options):
    """The one line of the error of an import."""
    with pytest.raises(InputError) as caught:
        import_logs(*args, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def still(count=80, **given):
    """A hull that moves with `MOVES` at attitudes that change, at a steady depth rate."""
    return [
        {"time": pd0_files.START + 2.0 * k, "depth": 30.0, "pitch": 12.0 * np.sin(0.3 * k),
         "roll": 8.0 * np.cos(0.2 * k), "heading": 7.0 * k, "water": MOVES, **given}
        for k in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("alignment", [0.0, 45.0])
@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize("axes", ["beam", "instrument", "ship", "earth"])
def test_each_axis_has_its_sign_in_all_axes_of_a_file(axes, upward, alignment, tmp_path):
    path = pd0_files.write(
        tmp_path / "a.pd0", still(axes=axes, upward=upward, alignment=alignment, angle=20.0,
                                  bottom=2.0 * MOVES),
    )  # fmt: skip
    found = relative_velocity(read_pd0(path).layouts)
    assert found.water[:, 0] == pytest.approx(np.tile(MOVES, (80, 1)), abs=2e-3)
    assert found.bottom == pytest.approx(np.tile(2.0 * MOVES, (80, 1)), abs=2e-3)
    assert np.nanmax(np.abs(found.error)) < 2e-3


@pytest.mark.parametrize("tilt", [-4.0, 0.0, 2.5])
def test_the_mounts_tilt_is_found_where_dives_and_climbs_differ(tilt, tmp_path):
    rng = np.random.default_rng(1)
    rows = pd0_files.yo(tilt=tilt, attack=(4.0, -1.0))
    rows = [{**row, "noise": 0.02 * rng.standard_normal(4)} for row in rows]
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    said = words(report)
    found, error = map(float, said.split("tilted ")[1].split(" degree")[0].split(" +- "))
    assert abs(found - tilt) < 2.5 * error
    assert error < 0.5
    dive = values(dataset, "measured_pitch") < 0.0
    attack = [
        np.degrees(np.arctan2(*(np.nanmean(values(dataset, n)[part]) for n in (W, U))))
        for part in (dive, ~dive)
    ]
    assert attack == pytest.approx([4.0, -1.0], abs=0.5)


def test_deviations_are_those_of_the_noise(tmp_path):
    rng = np.random.default_rng(2)
    rows = [{**row, "noise": 0.03 * rng.standard_normal(4)} for row in pd0_files.yo(600)]
    truth = np.array([row["water"] for row in rows])
    dataset, _ = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    for k, name in ((0, U), (1, V), (2, W)):
        error, said = values(dataset, name) - truth[:, k], values(dataset, f"{name}_deviation")
        good = np.isfinite(error)
        assert good.mean() > 0.9
        assert np.sqrt(np.mean((error[good] / said[good]) ** 2)) == pytest.approx(1.0, abs=0.25)


def test_weak_echoes_are_screened_and_told(tmp_path):
    rows = pd0_files.yo(600)
    for k, row in enumerate(rows):
        if 100.0 < row["depth"] < 150.0 and k % 3:
            row |= {"good": 80, "pulled": 0.7, "echo": 57}
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    kept = np.isfinite(values(dataset, U))
    depth = values(dataset, "measured_depth")
    assert kept[(depth > 102.0) & (depth < 148.0)].mean() == pytest.approx(1 / 3, abs=0.05)
    assert kept[(depth < 98.0) | (depth > 152.0)].all()
    assert np.nanmax(np.abs(values(dataset, U) - 0.4)) < 5e-3
    said = words(report)
    assert "by percent good" in said
    assert "fewer than 60% of ensembles kept from 100 m" in said
    lines = [line for line in said.splitlines() if "thresholds" in line]
    assert [line.split("thresholds ")[1].split(":")[0] for line in lines] == [
        "as set",
        "half",
        "twice",
    ]


@pytest.mark.parametrize(
    ("name", "worse", "screen"),
    [
        ("correlation", {"correlation": 70}, "correlation"),
        ("echo", {"echo": 41}, "echo"),
        ("error velocity", {"noise": np.array([0.3, 0.3, -0.3, -0.3])}, "error velocity"),
    ],
)
def test_each_screen_drops_what_it_is_for(name, worse, screen, tmp_path):
    rows = pd0_files.yo()
    for row in rows[100:120]:
        row |= worse
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert f"removed 20 a.pd0: ensembles, by {screen}" in words(report)
    kept = np.isfinite(values(dataset, U))
    assert kept.sum() == len(rows) - 20
    assert (values(dataset, "measured_dvl_mode")[kept] == 2.0).all()


@pytest.mark.parametrize("axes", ["instrument", "ship", "earth"])
def test_pings_with_three_beams_gave_a_velocity_too(axes, tmp_path):
    """Three beams, too large an error, fewer beams, four beams: by the maker's format."""
    rows = still(axes=axes, good=(40, 10, 5, 45))
    log = relative_velocity(read_pd0(pd0_files.write(tmp_path / "a.pd0", rows)).layouts)
    assert set(log.good[np.isfinite(log.good)]) == {85.0}


def test_a_speed_that_does_not_make_the_depth_rate_is_dropped_by_closure(tmp_path):
    rows = pd0_files.yo(600)
    for row in rows[80:160]:
        row |= {"pulled": 0.5}  # and every flag of quality is perfect
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    kept = np.isfinite(values(dataset, U))
    assert not kept[90:150].any()
    assert kept[:70].all()
    assert kept[170:].all()
    assert "by closure" in words(report)


def test_ship_axes_that_are_not_level_are_told_by_closure(tmp_path):
    rows = pd0_files.yo(axes="ship", level=False, says_level=True)
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert "ship axes are the hull's, against the file's word" in words(report)
    assert np.nanmax(np.abs(values(dataset, U) - 0.4)) < 5e-3
    level = pd0_files.yo(axes="ship", level=True)
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "b.pd0", level)])
    assert "against the file's word" not in words(report)
    assert np.nanmax(np.abs(values(dataset, U) - 0.4)) < 5e-3


@pytest.mark.parametrize("upward", [False, True])
def test_cells_of_a_pitched_hull_have_the_current_of_their_depths(upward, tmp_path):
    rows = pd0_files.yo(120, heading=330.0, cells=12, upward=upward)
    (one,) = read_pd0(pd0_files.write(tmp_path / "a.pd0", rows)).layouts
    turn = euler_to_matrix(*(np.radians(one[n]) for n in ("roll", "pitch", "heading")))
    beams = turn @ pd0_files.beam_directions(30.0, 45.0, upward=upward).T
    slant = (1.9 + np.arange(12.0)) / np.cos(np.radians(30.0))
    along = np.array([0.004, -0.003, 0.0]) @ beams  # of a shear, north and east, positive outward
    sheared = one["velocity"] - slant[:, None] * (beams[:, 2] * along)[:, None]
    found = hull_velocity("a", [{**one, "velocity": sheared}], None, Thresholds())
    ahead, starboard, below = found.cells[40:80, [3, 7]].T
    past = np.diff((ahead + 1j * starboard) * np.exp(1j * np.radians(330.0)), axis=0)
    assert np.nanmedian(past / np.diff(below, axis=0)) == pytest.approx(-0.004 + 0.003j, rel=0.05)
    assert (np.nanmedian(below) < 0.0) == upward


def test_bottom_and_water_track_have_names_of_their_own(tmp_path):
    rows = pd0_files.yo(alignment=0.0)
    for row in rows:
        row |= {"bottom": row["water"] + [0.1, 0.05, 0.0], "range": 25.0}
    dataset, _ = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert np.nanmedian(values(dataset, U)) == pytest.approx(0.4, abs=3e-3)
    assert np.nanmedian(values(dataset, "measured_bottom_surge")) == pytest.approx(0.5, abs=3e-3)
    assert np.nanmedian(values(dataset, "measured_bottom_sway")) == pytest.approx(0.05, abs=2e-3)
    assert np.nanmedian(values(dataset, "measured_altitude")) == pytest.approx(25.0)


# --- damage -------------------------------------------------------------------------------------


def test_damaged_ensembles_are_counted_and_the_others_read(tmp_path):
    path = pd0_files.write(tmp_path / "a.pd0", pd0_files.yo())
    data = bytearray(path.read_bytes())
    size = len(data) // 400
    for k in (7, 8, 200):
        data[k * size + 150] ^= 0x55
    path.write_bytes(b"junk" + data[: -size // 2])
    file = read_pd0(path)
    assert (file.damaged, file.cut, number(file)) == (3, True, 396)
    _, report = import_logs("pd0", [path])
    assert "removed 3 ensembles with a wrong checksum" in words(report, "a.pd0")
    assert "truncated" in words(report, "a.pd0")


def test_layouts_may_change_in_a_file_and_other_types_are_named(tmp_path):
    rows = pd0_files.yo()
    for row in rows[::2]:
        row |= {"cells": 9, "cell": 0.5, "others": (0x2000,)}
    dataset, report = import_logs("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert np.isfinite(values(dataset, U)).sum() == 400
    assert report.names["PD0 ensemble"]["not read"] == ("type 2000",)
    assert "bottom track" not in report.names["PD0 ensemble"]["read"]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 255)), min_size=1, max_size=40))
def test_changed_bytes_never_crash_the_decoder(changes):
    whole = b"".join(pd0_files.ensemble({**pd0_files.SETTINGS, **row}) for row in pd0_files.yo(6))
    data = bytearray(whole)
    for place, byte in changes:
        data[place % len(data)] = byte
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.pd0"
        path.write_bytes(data)
        try:
            file = read_pd0(path)
        except InputError:
            return
    assert number(file) + file.damaged <= 12
    assert number(file) <= 6


# --- refusals -----------------------------------------------------------------------------------


def test_a_file_that_is_no_pd0_is_refused(tmp_path):
    path = tmp_path / "a.pd0"
    path.write_bytes(b"\x7f\x79" + bytes(500))
    assert "no whole ensemble of PD0" in refused("pd0", [path])
    assert "begins with 7f79" in refused("pd0", [path])


def test_bottom_track_alone_is_refused(tmp_path):
    rows = pd0_files.yo(bottom=np.array([0.4, 0.0, 0.0]))
    for row in rows:
        row["water"] = None
    said = refused("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert "has bottom track alone (400 ensembles)" in said
    assert "dvl_lock = 'bottom'" in said


def test_a_water_track_that_contradicts_the_bottom_track_is_refused_with_numbers(tmp_path):
    rows = pd0_files.yo(600)
    for k, row in enumerate(rows):
        row |= {"heading": 0.6 * k, "bottom": row["water"] * [3.0, 1.0, 1.0]}
    said = refused("pd0", [pd0_files.write(tmp_path / "a.pd0", rows)])
    assert "contradicts its bottom track in 600 ensembles" in said
    share = float(said.split(" m/s, and ")[1].split("%")[0])
    assert share == pytest.approx(200.0 / 3.0, abs=4.0)
    for row in rows:  # a current explains as large a difference
        matrix = euler_to_matrix(0.0, np.radians(row["pitch"]), np.radians(row["heading"]))
        row["bottom"] = row["water"] + matrix.T @ [0.8, 0.0, 0.0]
    import_logs("pd0", [pd0_files.write(tmp_path / "b.pd0", rows)])


# --- beside a vehicle's log ---------------------------------------------------------------------

FLIGHT = Flight(dives=1, depth=120.0, surface=300.0, swing=1.0)


def carried(path, *, offset=0.0, turned=0.0, tilt=0.0, flight=FLIGHT, step=3.0):
    """The Doppler log of a flight, its clock `offset` seconds late and heading `turned` degrees."""
    start, end = flight.dive_times(0)
    time = np.arange(start + 5.0, end - 5.0, step)
    state = flight.state(time)
    state["heading"] = state["heading"] - turned - flight.variation
    rows = [
        {"time": t - offset, "depth": z, "pitch": p, "heading": h,
         "water": [s, 0.0, 0.0], "tilt": tilt}
        for t, z, p, h, s in zip(time, *(state[n] for n in ("depth", "pitch", "heading", "speed")),
                                 strict=True)
    ]  # fmt: skip
    return pd0_files.write(path, rows)


@pytest.mark.parametrize("offset", [0.0, -412.6, 37.4])
def test_clock_heading_and_tilt_are_found_beside_the_vehicles_log(offset, tmp_path):
    paths = samples.write("slocum", tmp_path / "logs", FLIGHT, layout="csv")
    doppler = carried(tmp_path / "d.pd0", offset=offset, turned=4.0, tilt=2.0)
    dataset, report = import_logs("slocum", paths, doppler=[doppler])
    said = words(report)
    seconds = float(said.split("clock ")[1].split(" ")[0])
    assert seconds == pytest.approx(offset, abs=0.5)
    assert float(said.split("heading ")[1].split(" ")[0]) == pytest.approx(
        4.0 + FLIGHT.variation, abs=0.3
    )
    assert float(said.split("tilted ")[1].split(" ")[0]) == pytest.approx(2.0, abs=0.3)
    surge = values(dataset, U)
    good = np.isfinite(surge)
    time = dataset["start_time"].values[0] + dataset["time"].values[: len(surge)]
    truth = FLIGHT.state(np.asarray(time, float))["speed"]
    assert good.sum() > 100
    level = truth * np.cos(np.radians(FLIGHT.pitch))
    assert np.nanmedian(values(dataset, "cell_ahead")) == pytest.approx(np.median(level), abs=0.01)
    assert surge[good] == pytest.approx(truth[good], abs=0.01)


def test_what_does_not_fit_a_vehicles_log_is_refused(tmp_path):
    paths = samples.write("slocum", tmp_path / "logs", FLIGHT, layout="csv")
    late = carried(tmp_path / "late.pd0", offset=86400.0)
    said = refused("slocum", paths, doppler=[late])
    assert "late.pd0 does not overlap" in said
    assert "2023-11-13" in said
    assert "2023-11-14" in said
    level = [{**row, "pitch": 0.0, "depth": 20.0} for row in pd0_files.yo(start=FLIGHT.time[0])]
    flat = pd0_files.write(tmp_path / "flat.pd0", level)
    assert "neither depth nor pitch varies" in refused("slocum", paths, doppler=[flat])
    assert "leave --doppler out" in refused("pd0", [flat], doppler=[flat])


def test_the_doppler_log_of_another_vehicle_is_refused(tmp_path):
    paths = samples.write("slocum", tmp_path / "logs", FLIGHT, layout="csv")
    shallow = carried(tmp_path / "a.pd0", flight=dataclasses.replace(FLIGHT, depth=80.0))
    said = refused("slocum", paths, doppler=[shallow])
    assert "a.pd0 is not of" in said
    assert "differ: depths by" in said
    start, end = FLIGHT.dive_times(0)
    turned = 0.1 * np.arange(0.0, end - start - 10.0, 3.0)
    said = refused("slocum", paths, doppler=[carried(tmp_path / "b.pd0", turned=turned)])
    assert "differ: headings by" in said
    assert "depths" not in said


def test_a_file_of_one_ensemble_sets_no_period(tmp_path):
    whole = pd0_files.write(tmp_path / "whole.pd0", pd0_files.yo(step=3.0))
    one = pd0_files.write(tmp_path / "one.pd0", pd0_files.yo(step=3.0)[:1])
    dataset, _ = import_logs("pd0", [whole, one])
    assert np.diff(dataset["time"].values)[:3] == pytest.approx(3.0)


def test_the_command_takes_both(tmp_path, capsys):
    paths = samples.write("slocum", tmp_path / "logs", FLIGHT, layout="csv")
    doppler = carried(tmp_path / "d.pd0")
    out = tmp_path / "real.zarr"
    words = ["import", "slocum", *map(str, paths), "--doppler", str(doppler), "--out", str(out)]
    assert PROGRAM.main(words) == 0
    assert "mount tilted" in " ".join(capsys.readouterr().out.split())
    assert sniff(doppler) == "pd0"


def test_the_ctd_gives_the_speed_of_sound(tmp_path):
    """Speeds measured with 1500 m/s in water of 1450 m/s are 3 % too large."""
    rows = pd0_files.yo()
    time = np.array([row["time"] for row in rows])
    channels = {
        "measured_depth": [row["depth"] for row in rows],
        "measured_pitch": [row["pitch"] for row in rows],
        "measured_roll": np.zeros(400),
        "measured_temperature": np.full(400, 4.0),
        "measured_salinity": np.full(400, 5.0),
    }
    log = DeploymentLog(
        deployment="x", platform="x", fixes=NO_FIXES, magnetic_variation=EMPTY,
        channels={n: Channel(time, np.asarray(v, float)) for n, v in channels.items()},
    )  # fmt: skip
    layouts = read_pd0(pd0_files.write(tmp_path / "a.pd0", rows)).layouts
    fewer = {n: c for n, c in log.channels.items() if n != "measured_salinity"}
    fresh = dataclasses.replace(log, channels=fewer)
    alone = hull_velocity("a", layouts, fresh, Thresholds())
    beside = hull_velocity("a", layouts, log, Thresholds())
    speed = gsw.sound_speed(gsw.SA_from_SP(5.0, 30.0, 0.0, 0.0), 4.0, 30.0)
    assert alone.sound == 1.0
    assert beside.sound == pytest.approx(speed / 1500.0, abs=2e-3)  # some 100 m deeper
    ratio = np.nanmean(beside.water[:, 0]) / np.nanmean(alone.water[:, 0])
    assert ratio == pytest.approx(beside.sound, abs=1e-3)


# --- real files ---------------------------------------------------------------------------------

PATHFINDER, EXPLORER, REMUS = (
    SHARED / name
    for name in ("slocum_pathfinder_2022", "slocum_explorer_ooi", "auv_remus600_ooi_2014")
)
real = pytest.mark.skipif(not PATHFINDER.is_dir(), reason="needs the shared real logs")


@real
@pytest.mark.parametrize(
    ("path", "ensembles", "bottom", "deepest"),
    [
        (PATHFINDER / "69696969.pd0", 4774, 0, 503.0),
        (PATHFINDER / "vb240501.pd0", 5831, 0, 753.0),
        (PATHFINDER / "vb231807.pd0", 249, 0, 68.0),
        (EXPLORER / "NE051400.PD0", 193, 163, 72.0),
        (EXPLORER / "ND161646.PD0", 38, 0, 17.0),
        (EXPLORER / "LB180210_3_corrupted.PD0", 2, 0, 0.2),
        (REMUS / "remus600_run1.pd0", 793, 793, 12.3),
        (REMUS / "remus600_run2.pd0", 1141, 1140, 12.8),
    ],
)
def test_real_files_hold_what_their_owners_say(path, ensembles, bottom, deepest):
    file = read_pd0(path)
    assert number(file) == ensembles
    locked = [np.isfinite(one["bottom_velocity"][:, :3]).all(axis=1).sum() for one in file.layouts]
    assert sum(locked) == bottom
    assert max(one["depth"].max() for one in file.layouts) == pytest.approx(deepest, abs=0.5)
    assert file.damaged == (1 if "corrupted" in path.name else 0)


@real
def test_a_real_gliders_angle_of_attack_is_alike_in_two_yos():
    found = []
    for name in ("69696969", "vb240501"):
        dataset, report = import_logs("pd0", [PATHFINDER / f"{name}.pd0"])
        pitch = values(dataset, "measured_pitch")
        surge, heave = values(dataset, U), values(dataset, W)
        for part in ((pitch < -22) & (pitch > -27), (pitch > 22) & (pitch < 27)):
            use = part & np.isfinite(surge)
            assert use.sum() > 300
            found.append(np.degrees(np.arctan2(heave[use].mean(), surge[use].mean())))
        assert "fewer than 60% of ensembles kept from 200, 250, 300" in words(report)
    assert found == pytest.approx([2.8, -2.8, 2.8, -2.8], abs=0.5)


@real
def test_two_runs_of_a_real_auv_have_one_tilt_and_a_small_current():
    tilts = []
    for run in (1, 2):
        dataset, report = import_logs("pd0", [REMUS / f"remus600_run{run}.pd0"])
        said = words(report)
        assert "against the file's word" in said
        tilts.append(float(said.split("tilted ")[1].split(" ")[0]))
        current = values(dataset, "measured_bottom_surge") - values(dataset, U)
        assert abs(np.nanmedian(current)) < 0.1
    assert tilts[0] == pytest.approx(tilts[1], abs=0.1)
