"""Trajectory: a mapping that saves, opens, plots and describes itself; tracks in CSV files."""

import dataclasses
import math

import numpy as np
import pytest
from pictures import short_scenario

import twin
from twin.__main__ import PROGRAM as TWIN
from twin.errors import InputError, StoreError
from twin.mission.segments import SawTooth, Surface
from twin.records.mission_dataset import summarise
from twin.records.schema import variable
from twin.records.tracks import read_tracks
from twin.records.trajectory import actuator_names


@pytest.fixture(scope="module")
def flown():
    scenario = dataclasses.replace(short_scenario(), duration=60.0)
    return twin.simulate(scenario, sensors="ideal")


def test_it_is_a_mapping(flown):
    assert "true_depth" in flown
    assert "true_deth" not in flown
    assert list(flown) == list(flown.keys()) == list(flown.signals)
    assert len(flown) == len(flown.items()) == len(flown.signals)
    assert dict(flown)["true_depth"] is flown["true_depth"]
    assert flown.get("nothing") is None
    assert flown == flown
    assert len({flown, dataclasses.replace(flown)}) == 2


@pytest.mark.parametrize("kind", [KeyError, InputError])
def test_a_wrong_name_offers_the_nearest(flown, kind):
    with pytest.raises(kind, match="did you mean 'true_depth'") as caught:
        flown["true_deth"]
    assert str(caught.value).startswith("unknown signal")  # no quotes around it, as KeyError has
    assert "others" in str(caught.value)  # not a wall of sixty names


def test_it_says_in_a_line_what_it_is(flown):
    text = repr(flown)
    assert text.startswith("<Trajectory: glider on 'short', 121 samples, 60 s, ")
    assert text.endswith("ended: duration>")
    assert len(text) < 140
    bare = dataclasses.replace(flown, signals={}, provenance={})
    assert repr(bare) == "<Trajectory: 121 samples, 60 s, 0 signals>"


def test_its_parts_are_positions_with_commands():
    names = ["true_fin", "true_pitch", "true_depth", "true_a_b", "true_shift"]
    commands = ["commanded_a_b", "commanded_pitch", "commanded_depth", "commanded_fin"]
    assert actuator_names([*names, *commands, "commanded_segment"]) == ("fin", "a_b")


def test_xarray_keeps_precision_and_meaning(flown):
    data = flown.to_xarray()
    assert data["true_pitch"].dims == ("time",)
    assert np.array_equal(data["true_pitch"].values, flown["true_pitch"])
    assert data["true_pitch"].attrs == variable("true_pitch").attributes()
    assert data["time"].attrs["units"] == "s"
    assert data.attrs["Conventions"].startswith("CF")
    assert data.attrs["ended"] == "duration"
    assert float(data["true_depth"].sel(time=30.0)) == flown["true_depth"][60]


@pytest.mark.parametrize("ending", [".zarr", ".nc"])
def test_what_is_saved_opens_again(flown, tmp_path, ending):
    path = flown.save(tmp_path / "new" / f"run{ending}")
    again = twin.open_trajectory(path)
    assert repr(again) == repr(flown)
    assert set(again) == set(flown)
    assert np.array_equal(again.time, flown.time)
    assert np.array_equal(again.states, flown.states)
    for name in flown:
        assert np.array_equal(again[name], flown[name].astype(np.float32), equal_nan=True), name
    with pytest.raises(StoreError, match="already exists"):
        flown.save(path)
    flown.save(path, overwrite=True)
    with pytest.raises(StoreError, match="missions 0 to 0, not 1"):
        twin.open_trajectory(path, 1)


def test_what_cannot_be_saved_or_opened_is_explained(flown, tmp_path):
    with pytest.raises(InputError, match=r"must end in \.zarr or \.nc"):
        flown.save(tmp_path / "run.csv")
    with pytest.raises(StoreError, match="no file at"):
        twin.open_trajectory(tmp_path / "none.nc")
    (tmp_path / "bad.nc").write_text("no netCDF")
    with pytest.raises(StoreError, match="cannot be read"):
        twin.open_trajectory(tmp_path / "bad.nc")
    other = tmp_path / "other.nc"
    flown.to_xarray().drop_attrs().to_netcdf(other)
    with pytest.raises(StoreError, match="holds no mission"):
        twin.open_trajectory(other)


def test_it_plots_itself(flown):
    assert flown.plot("track").axes[0].get_xlabel().startswith("east")
    titles = [axes.get_title(loc="left") for axes in flown.plot().axes]
    assert {"battery rotation", "pumped volume"} <= set(titles)
    with pytest.raises(KeyError, match="did you mean 'track'"):
        flown.plot("trak")
    with pytest.raises(InputError, match="option of figure 'section' 'color': did you mean"):
        flown.plot("section", color="pitch")


@pytest.mark.parametrize("parts", [(), ("pump",), ("shift", "rotation", "pump", "test_rudder")])
def test_figures_have_a_panel_for_each_part(flown, parts):
    from twin.records.schema import Variable, declare

    keep = {n: v for n, v in flown.items() if not n.startswith("commanded_") or "pitch" in n}
    for part in parts:
        if part not in ("shift", "rotation", "pump"):
            for group in ("true", "commanded"):
                declare(Variable(f"{group}_{part}", "degree", f"{part} angle", limits=(-90, 90)))
        keep[f"true_{part}"] = keep[f"commanded_{part}"] = np.linspace(0.0, 1.0, len(flown.time))
    changed = dataclasses.replace(flown, signals=keep | {"true_heading": flown["true_heading"]})
    assert set(changed.actuators) == set(parts)
    figure = changed.plot("actuator")
    assert len(figure.axes) == 2 + len(parts)
    if "test_rudder" in parts:
        assert "test_rudder angle" in [axes.get_title(loc="left") for axes in figure.axes]
    assert changed.plot("overview")


@pytest.mark.parametrize("name", ["start_nominal", "start_time", "start_latitude"])
@pytest.mark.parametrize("kind", ["zero", "cut"])
def test_damage_where_a_mission_began_is_named(flown, tmp_path, name, kind):
    path = flown.save(tmp_path / "flown.zarr")
    chunk = path / name / "c" / "0"
    if not chunk.exists():
        chunk = path / name / "c" / "0" / "0"
    data = chunk.read_bytes()
    chunk.write_bytes(data[:3] if kind == "cut" else data + b"\0")
    with pytest.raises(StoreError, match=r"^(the )?store .*cannot be read"):
        twin.open_trajectory(path)
    assert TWIN.main(["plot", str(path), "--out", str(tmp_path / "a.png")]) == 2


def test_the_angle_of_attack_is_that_of_the_flight_not_of_the_surface():
    mission = twin.Mission(
        name="dive and stay",
        segments=[SawTooth(max_depth_m=20.0, yos=1), Surface(duration_s=200.0)],
    )
    run = twin.simulate(mission=mission)
    v_rel = run.v_rel
    every = np.abs(np.rad2deg(np.arctan2(v_rel[:, 2], v_rel[:, 0])))
    assert np.percentile(every, 98) > 60.0  # it lies at the surface
    assert 1.0 < summarise(run)["angle_of_attack_p98_deg"] < 30.0


def test_a_vehicle_that_never_dives_has_no_angle_of_attack():
    mission = twin.Mission(name="stay", segments=[Surface(duration_s=20.0)])
    assert math.isnan(summarise(twin.simulate(mission=mission))["angle_of_attack_p98_deg"])


# --- tracks in CSV files --------------------------------------------------------------------------


HEADER = "mission,track,time,north,east\n"


def write(tmp_path, text):
    path = tmp_path / "reckoned.csv"
    path.write_text(text)
    return path


def test_rows_belong_to_missions_and_tracks(tmp_path):
    path = write(
        tmp_path,
        HEADER
        + "0,ekf,0,0,0\n0,ekf,1,0.1,0.30000000000000004\n3,ekf,0,5,5\n3,ekf,2,6,6\n"
        + "0,dvl,0,0,0\n0,dvl,1,nan,nan\n0,dvl,2,2,4\n",
    )
    ekf, dvl = read_tracks(path, 0)
    assert (ekf.name, ekf.east.tolist()) == ("ekf", [0.0, 0.30000000000000004])  # every bit
    assert (dvl.name, dvl.time.tolist(), dvl.east.tolist()) == ("dvl", [0.0, 2.0], [0.0, 4.0])
    (other,) = read_tracks(path, 3)
    assert other.north.tolist() == [5.0, 6.0]
    with pytest.raises(InputError, match=r"no track of mission 1"):
        read_tracks(path, 1)


def test_without_names_a_track_is_called_after_its_file(tmp_path):
    path = write(tmp_path, "time, north, east\n0, 0, 0\n\n1, 2, 3\n")
    (track,) = read_tracks(path)
    assert (track.name, track.north.tolist()) == ("reckoned", [0.0, 2.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,north\n0,1\n", "no column east"),
        (HEADER + "0,a,0,0,0\n0,a,1,x,0\n", "line 3: north is 'x', not a number"),
        (HEADER + "0,a,0,0,0\n0,a,1,2\n", "line 3: east is '', not a number"),
        (HEADER + "one,a,0,0,0\n", "line 2: mission is 'one', not a number"),
        (HEADER + "0,a,0,0,0,9\n", "cannot be read"),
        (HEADER + "0,a,0,0,0\n0,a,1,0,0,9,9\n", "cannot be read"),
        ("", "cannot be read"),
        (HEADER, "no track of mission 0"),
        (HEADER + "0,a,1,0,0\n0,a,0,0,0\n", "its times must increase"),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_tracks(write(tmp_path, text))
    assert "\n" not in str(caught.value)
