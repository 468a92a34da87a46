"""Currents from a line of text, and currents that describe themselves."""

import json

import numpy as np
import pytest

from twin.errors import CurrentError
from twin.water.current import (
    CurrentSum,
    Ekman,
    GaussMarkov,
    Geostrophic,
    Grid,
    Inertial,
    LogLayer,
    Origin,
    Profile,
    TidalEllipse,
    Tide,
    Uniform,
    current_from_dict,
    current_help,
    parse_current,
    still_water,
)

TEXTS = {
    "none": still_water(),
    "uniform:-0.05,-0.002": Uniform(north=-0.05, east=-0.002),
    "uniform:0.1,0.2,0.01": Uniform(north=0.1, east=0.2, down=0.01),
    "uniform:east=1e-1": Uniform(east=0.1),
    "uniform:speed=0.3,direction=90": Uniform.toward(0.3, 90.0),
    "ekman:tau=0.1,direction=90": Ekman(stress=0.1, direction_deg=90.0),
    "Ekman: tau=0.1, direction=90, az=0.05": Ekman(
        stress=0.1, direction_deg=90.0, viscosity=0.05
    ),
    "geostrophic:surface=0.2,direction=45,scale=600,barotropic=0.05": Geostrophic(
        baroclinic=0.2, direction_deg=45.0, scale_depth=600.0, barotropic=0.05
    ),
    "tide:m2=0.1,s2=0.03,direction=30,s2_phase=20": Tide(
        ellipses=(
            TidalEllipse(constituent="M2", semi_major=0.1, direction_deg=30.0),
            TidalEllipse(constituent="S2", semi_major=0.03, direction_deg=30.0, phase_deg=20.0),
        )
    ),
    "inertial:speed=0.08,layer=40": Inertial(speed=0.08, layer_depth=40.0),
    "gauss_markov:speed=0.1,std=0.05,direction=90,seed=4": GaussMarkov(
        speed=0.1, speed_std=0.05, direction_deg=90.0, seed=4
    ),
    "log-layer:friction=0.01,direction=0,bottom=100": LogLayer(
        friction_velocity=0.01, direction_deg=0.0, water_depth=100.0
    ),
    "grid:a+b.nc,lat=49,lon=-16,time=2000-01-05,w=none,hold=86400": Grid(
        path="a+b.nc", latitude_deg=49.0, longitude_deg=-16.0, time="2000-01-05", up="none",
        hold_s=86400.0,
    ),
    "uniform:1e-1,0 + ekman:tau=1e-1,direction=0+none": CurrentSum(
        parts=(Uniform(north=0.1), Ekman(stress=0.1, direction_deg=0.0))
    ),
    "uniform:1e+0,0+uniform:0,+1": CurrentSum(parts=(Uniform(north=1.0), Uniform(east=1.0))),
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
def test_text_becomes_the_current(text):
    assert parse_current(text) == TEXTS[text]


@pytest.mark.parametrize("text", [t for t in TEXTS if not t.startswith("grid")])
def test_a_description_rebuilds_the_same_bytes_and_a_pinned_one_without_the_origin(text):
    current, origin = TEXTS[text], Origin(latitude_deg=-20.0)
    program = current.compile(7200.0, origin).tobytes()
    rebuilt = current_from_dict(json.loads(json.dumps(current.describe())))
    assert rebuilt == current
    assert rebuilt.compile(7200.0, origin).tobytes() == program
    pinned = current_from_dict(current.pinned(7200.0, origin).describe())
    assert pinned.compile(7200.0).tobytes() == program


def test_the_help_names_only_what_parses(tmp_path):
    (tmp_path / "FILE.csv").write_text("depth,north,east\n0,0.1,0.2\n")
    for line in current_help().splitlines()[:-1]:
        text = line.split("  ")[0].replace("FILE", str(tmp_path / "FILE"))
        assert parse_current(text).kind


def test_profile_csv(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text(
        "# ADCP, mean of the morning\ndepth_m, u, v, w\n\n0,0.1,0.2,0.01\n50,0.3,-0.1,0\n"
    )
    profile = parse_current(f"profile:{path}")
    assert profile == Profile(depth=(0, 50), north=(0.2, -0.1), east=(0.1, 0.3), down=(-0.01, 0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("depth,north,east\n0,0.1,0.2\n10,nan,0.1\n", r"row 3 \(depth 10 m\): north is nan"),
        ("depth,north,east\n0,0.1,0.2\n\n10,,0.1\n", "row 4: north is '', not a number"),
        ("depth,north,east\n-5,0.1,0.2\n", "row 2: depth -5 m is negative; depth is positive down"),
        ("depth,north,east\n10,0.1,0.2\n5,0.1,0.1\n", "row 3: depth 5 m does not increase"),
        ("depth,north,east\n10,0.1\n", "row 2: 2 values, the header has 3"),
        ("depth,north,east\n10,30,0\n", "north is 30 m/s, beyond 10 m/s; convert the table to m/s"),
        ("depth,nort,east\n0,0,0\n", "unknown column 'nort': did you mean 'north'"),
        ("depth,east\n0,0\n", "no column north: a profile needs"),
        ("depth,u,east,v\n0,0,0,0\n", "two columns for east"),
        ("depth,north,east\n", "at least one depth"),
        ("", "is empty"),
    ],
)
def test_a_bad_profile_names_file_and_row(tmp_path, text, message):
    path = tmp_path / "profile.csv"
    path.write_text(text)
    with pytest.raises(CurrentError, match=message) as caught:
        parse_current(f"profile:{path}")
    assert "profile.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("uniforn:0.1,0", "unknown current 'uniforn': did you mean 'uniform'"),
        ("", "unknown current ''.*allowed: .*ekman"),
        ("uniform", "current 'uniform' needs settings, e.g. uniform:-0.05,-0.002"),
        ("uniform:0.1", "write uniform:NORTH,EAST"),
        ("uniform:0.1,a", "value 2 must be a number, not 'a'"),
        ("uniform:nan,0", "value 1 must be a number, not 'nan'"),
        ("uniform:0.1,0.1,sped=3", "write uniform:NORTH,EAST"),
        ("ekman:tau=0.1", "ekman: direction= is missing; settings: tau"),
        ("ekman:0.1,90", "ekman: write NAME=VALUE, not '0.1'"),
        ("ekman:tau=0.1,directon=9", "unknown ekman setting 'directon': did you mean 'direction'"),
        ("ekman:tau=0.1,tau=0.2,direction=0", "tau= is given twice"),
        ("tide:m2=0.1,m9=3", "unknown tide setting 'm9'"),
        ("tide:direction=3", "at least one constituent"),
        ("tide:m2=0.1,s2_phase=3", "unknown tide setting 's2_phase'"),
        ("gauss-markov:speed=0.1,std=0.1,direction=0,seed=1.5", "seed must be a whole number"),
        ("grid:lat=4", "give one file first"),
        ("grid:f.nc,latt=4", "unknown grid setting 'latt': did you mean 'lat'"),
        ("grid:f.nc,lat=4", "give both lat and lon"),
        ("grid:f.nc,time=yesterday", "time 'yesterday' is not ISO 8601"),
        ("grid:f.nc,land=mud", "unknown land 'mud'"),
        ("profile:", "current 'profile' needs settings"),
        ("profile:missing.csv", "cannot read the current profile missing.csv"),
        ("none:1", "takes no settings"),
        ("uniform:0,0+eckman:tau=1", "unknown current 'eckman': did you mean 'ekman'"),
    ],
)
def test_errors_teach(text, message):
    with pytest.raises(CurrentError, match=message) as caught:
        parse_current(text)
    assert "\n" not in str(caught.value)


def test_a_bad_description_is_named():
    with pytest.raises(CurrentError, match="unknown current 'unifrom'"):
        current_from_dict({"kind": "unifrom"})
    with pytest.raises(CurrentError, match="unknown uniform setting 'nord': did you mean 'north'"):
        current_from_dict({"kind": "uniform", "nord": 1.0})
    with pytest.raises(CurrentError, match="needs 'kind'"):
        current_from_dict({"north": 1.0})
    with pytest.raises(CurrentError, match=r"ekman: .*stress.*direction_deg"):
        current_from_dict({"kind": "ekman"})


def test_drawn_settings_are_described_in_plain_json():
    drawn = GaussMarkov(
        speed=np.float32(0.5), speed_std=np.float64(0.1), direction_deg=0.0, seed=np.int64(3)
    )
    assert current_from_dict(json.loads(json.dumps(drawn.describe()))) == drawn


def test_velocity_broadcasts():
    u = parse_current("uniform:0.1,0.2").velocity(np.zeros((3, 1)), 0.0, 0.0, np.zeros(4))
    assert u.shape == (3, 4, 3)
