"""The commands of `twin` as users and programs meet them; durations; `twin compile`."""

import dataclasses
import json
import subprocess
import sys

import pytest
import xarray as xr
from pictures import call, refused
from processes import python

from factory.commands.generate import Generate
from glider_twin_ops.commands.forecast import ForecastSurfacings
from glider_twin_protocols.serve_command import Serve
from twin.cli.options import duration
from twin.cli.parsing import parse_options
from twin.commands.simulate import Simulate
from twin.errors import InputError


@pytest.mark.parametrize("model", ["mujoco", "fossen"])
def test_trim_json(capsys, model):
    words = ("trim", "--net-mass", 0.3, "--shift", 0.02, "--rotation", 45, "--model", model)
    code, out, _ = call(capsys, *words, "--json")
    assert code == 0
    figures = json.loads(out)
    assert figures.keys() >= {
        *("speed_m_s", "vertical_speed_m_s", "angle_of_attack_deg", "sideslip_deg", "roll_deg"),
        *("pitch_deg", "turn_rate_rad_s", "turn_radius_m"),
    }
    assert figures["speed_m_s"] == pytest.approx(0.4902, rel=3e-3)
    assert figures["turn_radius_m"] == pytest.approx(101.5, rel=1e-2)


def test_trim_straight_has_no_radius_and_negative_numbers_parse(capsys):
    code, out, _ = call(capsys, "trim", "--net-mass", "-0.3", "--shift", "-0.02", "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["turn_radius_m"] is None
    assert figures["vertical_speed_m_s"] < 0
    assert '"roll_deg": 0.0,' in out
    code, out, _ = call(capsys, "trim", "--net-mass", "-0.3", "--shift", "-0.02")
    assert code == 0
    assert "-0.000" not in out


@pytest.mark.parametrize("model", ["mujoco", "fossen"])
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("--net-mass 0 --shift 0.02", 1, "neutrally buoyant"),
        ("--net-mass 0.3 --shift -0.02", 1, "move the shift forward"),
        ("--net-mass 0.3 --shift 0.2", 2, "shift 0.2 m is outside the travel"),
        ("--net-mass 3 --shift 0.02", 2, "net mass 3 kg is outside"),
        ("--net-mass 0.3 --shift 0.02 --rotation 120", 2, "rotation 120 deg"),
        ("--net-mass nan --shift 0.02", 2, "--net-mass must be a finite number"),
        ("--net-mass 0.3 --shift 0.02 --vehicle glidr", 2, "did you mean"),
    ],
)
def test_trim_refusals(capsys, model, words, code, message):
    assert message in refused(capsys, "trim", *words.split(), "--model", model, code=code)


def test_simulate_writes_what_xarray_opens(capsys, tmp_path):
    out_path, plot = tmp_path / "run.zarr", tmp_path / "run.png"
    words = ("simulate", "--duration", "120", "--out", out_path, "--plot", plot)
    code, out, _ = call(capsys, *words, "--current", "uniform:0.1,-0.05", "--json")
    assert code == 0
    figures = json.loads(out)
    assert figures["samples"] == 241
    assert figures["mean_current_north_m_s"] == pytest.approx(0.1)
    dataset = xr.open_zarr(out_path)
    assert dataset["true_depth"].attrs["units"] == "m"
    assert plot.stat().st_size > 10_000
    assert "--overwrite" in refused(capsys, *words)
    assert call(capsys, *words, "--overwrite")[0] == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("nowhere.toml", "nowhere.toml"),
        ("defalt", "did you mean 'default'"),
        ("--current unifrm:1,2", "did you mean 'uniform'"),
        ("--current grid:nowhere.nc,lat=49,lon=-16", "nowhere.nc"),
        ("--density termocline", "did you mean 'thermocline'"),
        ("--timestep -1", "timestep -1"),
        ("--timestep 1e-9", "timestep 1e-09 s is outside"),
        ("--duration 0", "duration 0"),
        ("--duration 1e9", "samples, more than"),
        ("--duration 1e308", "is outside 0.0001 to 1e+10 s"),
        ("--vehicle rogue --hydrodynamics elipsoid", "ellipsoid"),
        ("--out /proc/nowhere/run.zarr", "/proc/nowhere"),
        ("--sample-period nan", "sample period nan"),
        ("--sample-period 0.33", "the nearest is 0.3 s"),
        ("--sample-period 5000", "fewer than two samples"),
        ("--sample-period 1e-308", "is outside 0.0001 to 1e+10 s"),
        ("--integrator implicitfast", "too long for the stiff servos"),
        ("--plot picture.txt", "must be a file ending in .png"),
        ("--plot .", "must be a file ending in .png"),
    ],
)
def test_simulate_refuses_before_anything_is_flown(capsys, words, message):
    assert message in refused(capsys, "simulate", *words.split())


def test_mission_and_density_files(capsys, tmp_path):
    mission = tmp_path / "m.toml"
    mission.write_text(
        '[[segments]]\nkind = "saw-tooth"\nmax_depth_m = 30\npitch_deg = 75\n'
        "heading_deg = 10\nyos = 1\n"
    )
    assert "pitch_deg" in refused(capsys, "simulate", mission)
    mission.write_text(mission.read_text().replace("75", "30"))
    water = tmp_path / "cast.csv"
    water.write_text("depth,density\n0,1024\n50,1026\n40,1027\n")
    assert "row 2" in refused(capsys, "simulate", mission, "--density", water)
    water.write_text("depth,density\n0,1024.5\n50,1025.5\n")
    code, out, _ = call(capsys, "simulate", str(mission), "--density", str(water), "--json")
    assert code == 0
    assert json.loads(out)["max_depth_m"] == pytest.approx(31, abs=2)


def test_ellipsoid_mission_flies(capsys):
    words = ("simulate", "--hydrodynamics", "ellipsoid", "--duration", "300", "--json")
    code, out, _ = call(capsys, *words)
    assert code == 0
    assert json.loads(out)["distance_through_water_m"] > 20


def test_check_json_of_a_few_manoeuvres(capsys):
    code, out, _ = call(capsys, "check", "--manoeuvres", "2", "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["ok"]
    assert 0 < figures["speed_m_s"] <= 1e-3
    assert 0 < figures["attitude_deg"] <= 0.1
    assert 0 < figures["position_percent"] <= 0.3


def test_bench_json(capsys):
    code, out, _ = call(capsys, "bench", "--rounds", "1", "--threads", "2", "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["threads"] == 2
    for key in ("us_per_step", "us_per_step_untimed", "overhead_ratio", "times_real_time"):
        assert figures[key] > 0


def test_a_mission_that_was_not_flown_says_so(capsys, tmp_path):
    mission = tmp_path / "m.toml"
    mission.write_text(
        '[[segments]]\nkind = "saw-tooth"\nmax_depth_m = 60\nheading_deg = 10\nyos = 1\n'
    )
    water = tmp_path / "cast.csv"
    water.write_bytes(b"\xef\xbb\xbfdepth,density\n0,1025\n10,1035\n100,1040\n")
    code, out, err = call(capsys, "simulate", str(mission), "--density", str(water), "--json")
    assert code == 0
    assert json.loads(out)["ended"] == "time limit"
    assert "not flown to its end" in err
    code, out, err = call(capsys, "simulate", str(mission), "--json")
    assert json.loads(out)["ended"] == "flown"
    assert err == ""


def test_a_closed_output_is_no_error():
    words = f"{sys.executable} -m twin version >&-"
    done = subprocess.run(words, shell=True, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.parametrize(
    "text",
    [
        'duration_s = 1e308\n[[segments]]\nkind = "hold"\n',
        '[[segments]]\nkind = "hold"\nduration_s = 1e308\n',
        '[[segments]]\nkind = "saw-tooth"\nmax_depth_m = 50\npitch_deg = 25\nyos = 1e308\n',
    ],
)
def test_numbers_beyond_every_mission_are_refused(capsys, tmp_path, text):
    path = tmp_path / "mission.toml"
    path.write_text(text)
    told = refused(capsys, "simulate", path)
    assert "1e+308 is not possible: give a number of at most 1e+09" in told


def test_plot_and_out_of_the_folder_that_one_is_in(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ". is an empty folder, not a store of missions" in refused(capsys, "plot", ".")
    told = refused(capsys, "simulate", "--duration", "20", "--out", ".")
    assert ". is a folder without its name: give the store one" in told
    assert list(tmp_path.parent.glob("*.generating")) == []


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "a" * 300),
        ("simulate", "--duration", "20", "--out", "a" * 300),
        ("plot", "a" * 300),
        ("flight", "a" * 6000),
    ],
)
def test_names_too_long_for_a_file_are_bad_input_and_cut(capsys, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    told = refused(capsys, *words)
    assert told.endswith("File name too long")
    assert len(told) < 1300
    assert list(tmp_path.iterdir()) == []


# --- durations ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("6h", "s", 21600.0), ("90min", "h", 1.5), ("90 MIN", "s", 5400.0), ("2d", "h", 48.0),
     ("12", "h", 12.0), ("1e3", "s", 1000.0), ("0.1", "h", 0.1), (".5h", "min", 30.0)],
)  # fmt: skip
def test_units(text, unit, expected):
    assert duration(text, unit) == expected


@pytest.mark.parametrize("text", ["", "h", "6 weeks", "1h30", "six", "nan", "inf", "1e999h"])
def test_what_is_none_is_refused(text):
    with pytest.raises(InputError, match="is no duration: give a number with s, min, h or d"):
        duration(text, "s")


@pytest.mark.parametrize(
    ("command", "option", "hour", "bare"),
    [(Simulate, "duration", 3600.0, 90.0), (ForecastSurfacings, "hours", 1.0, 90.0),
     (Generate, "hours", 1.0, 90.0)],
)  # fmt: skip
def test_options_take_both(command, option, hour, bare):
    for word, expected in (("60min", hour), ("90", bare)):
        found = parse_options(command, prog="x", words=[f"--{option}", word])
        assert found is not None
        assert dataclasses.asdict(found)[option] == expected
    with pytest.raises(InputError, match=rf"--{option}.*'6 weeks'"):
        parse_options(command, prog="x", words=[f"--{option}", "6 weeks"])


@pytest.mark.parametrize(
    ("command", "words", "told"),
    [
        (Simulate, ["--duration", "6", "weeks"], "--duration: '6 weeks'.*s, min, h or d, .*42d"),
        (Simulate, ["--duration=6", "Hours", "--json"], "--duration: '6 Hours' .*such as 6h"),
        (Generate, ["--hours", "90", "min"], "--hours: '90 min' is no duration: .*such as 90min"),
        (Serve, ["--silence", "2", "s"], "--silence: '2 s' is no duration: .*such as 2s"),
    ],
)
def test_a_unit_that_stands_alone_is_no_mission(command, words, told):
    with pytest.raises(InputError, match=told):
        parse_options(command, prog="x", words=words)


def test_a_mission_may_stand_behind_a_duration():
    for number in ("3600", "6h"):
        found = parse_options(Simulate, prog="x", words=["--duration", number, "transects"])
        assert found is not None
        assert found.mission == "transects"
    # what is no duration's number is left to others
    found = parse_options(Simulate, prog="x", words=["--seed", "6", "weeks"])
    assert found is not None
    assert found.mission == "weeks"


# --- twin compile ---------------------------------------------------------------------------------


FLY = """
from numba.core import event
import twin

with event.install_recorder("numba:compile") as made:
    for engine in ("mujoco", "lanes"):
        twin.simulate(vehicle="glider", engine=engine, duration=60.0)
print(len(made.buffer))
"""


def test_afterwards_a_flight_finds_everything():
    done = python("-m", "twin", "compile", "--vehicle", "glider", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["vehicles"] == ["glider"]
    assert answer["seconds"] > 0.0
    flown = python("-c", FLY)
    assert flown.returncode == 0, flown.stderr
    assert flown.stdout.strip() == "0"


def test_what_is_no_vehicle_is_told_before_anything_is_compiled():
    done = python("-m", "twin", "compile", "--vehicle", "glider", "nothing")
    assert done.returncode == 2
    assert "nothing" in done.stderr
    assert len(done.stderr.splitlines()) == 1
