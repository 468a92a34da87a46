"""Analytic currents: formulas, invariants, statistics; their texts and descriptions."""

import json
import math

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
    Series,
    TidalEllipse,
    Tide,
    Uniform,
    current_from_dict,
    current_help,
    parse_current,
    still_water,
)
from twin.water.current.axes import coriolis
from twin.water.current.sampler import sample, sample_track
from twin.water.current.tide import PERIOD_HOURS

MONTEREY = Origin(latitude_deg=36.8)


def test_still_water_is_zero_and_an_empty_program_too():
    assert sample(still_water().compile(10.0), 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0) == (0.0,) * 6
    assert sample(np.zeros(0), 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0) == (0.0,) * 6


def test_uniform_is_positive_toward_north_east_down():
    u = Uniform(north=0.1, east=-0.2, down=0.03).velocity(5.0, 1e4, -1e4, [0.0, 900.0])
    np.testing.assert_array_equal(u, [[0.1, -0.2, 0.03]] * 2)
    np.testing.assert_allclose(
        Uniform.toward(0.3, 90.0).velocity(0, 0, 0, 0), [0, 0.3, 0], atol=1e-16
    )


def test_profile_is_linear_between_rows_and_held_beyond_them():
    profile = Profile(depth=(10.0, 20.0, 60.0), north=(0.1, 0.3, -0.1), east=(0, 1, 2))
    depth = [-1.0, 0.0, 10.0, 15.0, 20.0, 50.0, 60.0, 1000.0]
    u = profile.velocity(0, 0, 0, depth)
    np.testing.assert_allclose(u[:, 0], np.interp(depth, profile.depth, profile.north), atol=1e-15)
    np.testing.assert_allclose(u[:, 1], np.interp(depth, profile.depth, profile.east), atol=1e-15)


def test_a_profile_of_one_row_is_uniform():
    u = Profile(depth=(50.0,), north=(0.2,), east=(0.1,)).velocity(0, 0, 0, [0.0, 50.0, 99.0])
    np.testing.assert_array_equal(u, [[0.2, 0.1, 0.0]] * 3)


def test_ekman_surface_speed_and_angle():
    """V0 0.074 m/s and 45 degrees to the right of the wind at 36.8 N."""
    u = Ekman(stress=0.1, direction_deg=90.0).velocity(0, 0, 0, 0, MONTEREY)
    assert math.hypot(*u[:2]) == pytest.approx(0.074, abs=5e-4)
    assert math.degrees(math.atan2(u[1], u[0])) == pytest.approx(135.0)


@pytest.mark.parametrize("viscosity", [0.005, 0.02, 0.08])
@pytest.mark.parametrize("latitude", [36.8, -36.8])
def test_ekman_transport_is_stress_over_density_and_f(viscosity, latitude):
    """1.12 m2/s at right angles to the wind, whatever the viscosity."""
    depth = np.linspace(0.0, 1500.0, 60_001)
    u = Ekman(stress=0.1, direction_deg=0.0, viscosity=viscosity, latitude_deg=latitude)
    north, east, _ = np.trapezoid(u.velocity(0, 0, 0, depth), depth, axis=0)
    assert abs(east) == pytest.approx(1.12, abs=0.005)
    assert east == pytest.approx(0.1 / 1025.0 / coriolis(latitude), rel=1e-5)
    assert north == pytest.approx(0.0, abs=1e-4)


def test_ekman_equals_the_complex_spiral():
    """u + i v = V0 exp(z/d) exp(i(wind - pi/4 + z/d)), east and north, angle from east."""
    f, az, wind = coriolis(36.8), 0.02, math.radians(30.0)
    depth = np.array([0.0, 5.0, 21.0, 60.0])
    d, v0 = math.sqrt(2 * az / f), 0.1 / (1025.0 * math.sqrt(az * f))
    z = -depth / d
    spiral = v0 * np.exp(z) * np.exp(1j * (wind - math.pi / 4 + z))
    u = Ekman(stress=0.1, direction_deg=60.0).velocity(0, 0, 0, depth, MONTEREY)
    np.testing.assert_allclose(u[:, 1] + 1j * u[:, 0], spiral, atol=1e-15)


def test_ekman_refuses_the_equator():
    with pytest.raises(CurrentError, match=r"latitude_deg 1 is within 2 degree"):
        Ekman(stress=0.1, direction_deg=0.0, latitude_deg=1.0).compile(10.0)


def test_geostrophic_shear():
    current = Geostrophic(
        baroclinic=0.2, direction_deg=0.0, scale_depth=500.0, barotropic=0.05,
        barotropic_direction_deg=90.0,
    )  # fmt: skip
    depth = np.array([0.0, 250.0, 1000.0])
    u = current.velocity(0, 0, 0, depth)
    np.testing.assert_allclose(u[:, 0], 0.2 * np.exp(-depth / 500.0), rtol=1e-14)
    np.testing.assert_allclose(u[:, 1], 0.05, rtol=1e-14)


def test_tidal_ellipse_axes_sense_and_phase():
    ellipse = TidalEllipse(
        constituent="m2", semi_major=0.3, semi_minor=0.1, direction_deg=30.0, phase_deg=90.0
    )
    period = 12.4206 * 3600.0
    t = period * (0.25 + np.arange(4) / 4)
    u = Tide(ellipses=(ellipse,)).velocity(t, 0, 0, 0)
    along, left = np.radians(30.0), np.radians(30.0 - 90.0)
    major = np.array([math.cos(along), math.sin(along), 0.0])
    minor = np.array([math.cos(left), math.sin(left), 0.0])
    expected = [0.3 * major, 0.1 * minor, -0.3 * major, -0.1 * minor]
    np.testing.assert_allclose(u, expected, atol=1e-5)


@pytest.mark.parametrize("phase", [0.0, 40.0, 90.0, 200.0])
@pytest.mark.parametrize("minor", [0.1, -0.1])
def test_a_positive_minor_axis_turns_counterclockwise_seen_from_above(phase, minor):
    """At any phase, the default 0 included: compass directions fall when it turns to the left."""
    ellipse = TidalEllipse(
        constituent="M2", semi_major=0.3, semi_minor=minor, direction_deg=75.0, phase_deg=phase
    )
    period = 2.0 * math.pi / ellipse.angular_rate
    t = np.linspace(0.0, period, 97)
    north, east, _ = Tide(ellipses=(ellipse,)).velocity(t, 0, 0, 0).T
    turned = np.degrees(np.diff(np.unwrap(np.arctan2(east, north))))
    assert (np.sign(turned) == -np.sign(minor)).all()
    assert turned.sum() == pytest.approx(-360.0 * np.sign(minor))
    # The greatest speed is along the major axis, a lag after the start; the least across it.
    flood = np.interp(period * phase / 360.0, t, np.hypot(north, east))
    slack = np.interp((period * (phase / 360.0 + 0.25)) % period, t, np.hypot(north, east))
    assert (flood, slack) == (pytest.approx(0.3, abs=2e-4), pytest.approx(0.1, abs=2e-3))


def test_tidal_periods_are_those_of_doodson_s_numbers():
    """Rates [degree/h] of lunar time, and of the mean longitudes of Moon, Sun and lunar perigee."""
    rates = 14.49205212, 0.54901653, 0.04106864, 0.00464183
    numbers = {
        "M2": (2, 0, 0, 0), "S2": (2, 2, -2, 0), "N2": (2, -1, 0, 1), "K2": (2, 2, 0, 0),
        "K1": (1, 1, 0, 0), "O1": (1, -1, 0, 0), "P1": (1, 1, -2, 0), "Q1": (1, -2, 0, 1),
    }  # fmt: skip
    expected = {name: 360.0 / np.dot(times, rates) for name, times in numbers.items()}
    assert expected.keys() == PERIOD_HOURS.keys()
    for name, hours in expected.items():
        assert PERIOD_HOURS[name] == pytest.approx(hours, abs=2e-5), name
        rate = TidalEllipse(constituent=name.lower(), semi_major=0.1).angular_rate
        assert rate == pytest.approx(math.tau / (3600.0 * hours), rel=1e-6)


def test_tide_errors():
    with pytest.raises(CurrentError, match=r"unknown tidal constituent 'M3'.*M2"):
        TidalEllipse(constituent="M3", semi_major=0.1)
    with pytest.raises(CurrentError, match=r"M2 needs semi_major >= \|semi_minor\|"):
        TidalEllipse(constituent="M2", semi_major=0.1, semi_minor=-0.2)
    m2 = TidalEllipse(constituent="M2", semi_major=0.1)
    with pytest.raises(CurrentError, match="M2 is given twice"):
        Tide(ellipses=(m2, m2))


@pytest.mark.parametrize(("latitude", "quarter"), [(36.8, 90.0), (-36.8, -90.0)])
def test_inertial_oscillation_turns_clockwise_in_the_north(latitude, quarter):
    current = Inertial(speed=0.1, layer_depth=40.0, decay_depth=10.0, latitude_deg=latitude)
    period = 12.0 * 3600.0 / math.sin(math.radians(36.8))
    u = current.velocity([0.0, period / 4], 0, 0, 10.0)
    assert math.degrees(math.atan2(u[1, 1], u[1, 0])) == pytest.approx(quarter, abs=0.3)
    np.testing.assert_allclose(np.hypot(u[:, 0], u[:, 1]), 0.1)
    assert period == pytest.approx(20.0 * 3600.0, rel=2e-3)
    assert np.linalg.norm(current.velocity(0, 0, 0, 50.0)) == pytest.approx(0.1 / math.e)


def test_log_layer():
    current = LogLayer(
        friction_velocity=0.01,
        direction_deg=90.0,
        water_depth=100.0,
        roughness=1e-3,
        thickness=20.0,
    )
    east = current.velocity(0, 0, 0, [100.0, 99.9995, 99.0, 80.0, 50.0])[:, 1]
    top = 0.01 / 0.41 * math.log(20.0 / 1e-3)
    np.testing.assert_allclose(east, [0, 0, 0.01 / 0.41 * math.log(1e3), top, top], atol=1e-15)


@pytest.mark.parametrize(
    ("correlation_time", "interval", "count"),
    [(600.0, 60.0, 200_000), (600.0, 600.0, 80_000), (10800.0, 10800.0, 80_000),
     (60.0, 120.0, 80_000)],
)  # fmt: skip
def test_gauss_markov_statistics_are_those_of_the_exact_discretisation(
    correlation_time, interval, count
):
    """At intervals below and beyond T; x[k+1] regressed on x[k] would give another for T + 5 %."""
    current = GaussMarkov(
        speed=1.0, direction_deg=10.0, speed_std=0.1, direction_std_deg=20.0,
        correlation_time=correlation_time, interval=interval, seed=5, max_speed=2.0,
    )  # fmt: skip
    time, speed, direction = current.draw(interval * count)
    assert np.diff(time).max() == interval
    for x, mean, std in ((speed, 1.0, 0.1), (np.degrees(direction), 10.0, 20.0)):
        assert x.mean() == pytest.approx(mean, abs=0.04 * std)
        assert x.std() == pytest.approx(std, rel=0.03)
        for lag in (1, 10):
            kept = math.exp(-lag * interval / correlation_time)
            # four standard errors of a correlation: 4 sqrt((1 - 1/e^2) / 80 000) = 0.013
            tolerance = 0.013 if lag == 1 else 0.03
            assert np.corrcoef(x[:-lag], x[lag:])[0, 1] == pytest.approx(kept, abs=tolerance)


def test_gauss_markov_starts_stationary():
    first = [
        GaussMarkov(speed=1.0, direction_deg=0.0, speed_std=0.1, seed=s).draw(60.0)[1][0]
        for s in range(400)
    ]
    assert np.std(first) == pytest.approx(0.1, rel=0.15)


def test_gauss_markov_is_clipped_seeded_and_a_longer_mission_extends_it():
    current = GaussMarkov(
        speed=0.1, direction_deg=0.0, speed_std=0.1, min_speed=0.05, max_speed=0.15, seed=7
    )
    _, speed, _ = current.draw(36_000.0)
    assert speed.min() == 0.05
    assert speed.max() == 0.15
    t = np.linspace(0.0, 3000.0, 50)
    short, long = current.compile(3600.0), current.compile(36_000.0)
    assert short.tobytes() == current.compile(3600.0).tobytes()
    zero = np.zeros_like(t)
    rest = (zero,) * 6
    np.testing.assert_array_equal(sample_track(short, t, *rest), sample_track(long, t, *rest))
    other = GaussMarkov(speed=0.1, direction_deg=0.0, speed_std=0.1, seed=8)
    assert not np.array_equal(other.draw(3600.0)[1], current.draw(3600.0)[1])


def test_sums_add_velocities_and_flatten():
    a, b = Uniform(north=0.1), Ekman(stress=0.1, direction_deg=0.0)
    c = Tide(ellipses=(TidalEllipse(constituent="S2", semi_major=0.2),))
    total = a + b + c
    assert isinstance(total, CurrentSum)
    assert total.parts == (a, b, c)
    point = (1234.0, 10.0, 20.0, 30.0)
    parts = sum(x.velocity(*point) for x in (a, b, c))
    np.testing.assert_allclose(total.velocity(*point), parts, rtol=1e-14)
    assert (still_water() + a).parts == (a,)


def test_a_series_goes_through_its_values_and_holds_the_last():
    current = Series(interval=600.0, north=(0.1, 0.3, -0.2), east=(0.0, 0.0, 0.4))
    found = current.velocity([0.0, 600.0, 1200.0, 9e5], 0.0, 0.0, 10.0)
    expected = [[0.1, 0.0], [0.3, 0.0], [-0.2, 0.4], [-0.2, 0.4]]
    np.testing.assert_allclose(found[:, :2], expected, atol=1e-12)
    assert parse_current("series:interval=600,north=0.1/0.3/-0.2,east=0/0/0.4") == current


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Uniform(north=math.nan), "uniform: north must be a finite number in m/s"),
        (lambda: Uniform(east=25.0), "east is 25.0 m/s, beyond 10 m/s"),
        (lambda: Ekman(stress=-1.0, direction_deg=0.0), "stress must be at least 0 Pa, not -1"),
        (lambda: Geostrophic(baroclinic=0.1, direction_deg=0.0, scale_depth=0.0), "scale_depth"),
        (lambda: Profile(depth=(0.0, 5.0), north=(0.0, math.nan), east=(0.0, 0.0)),
         r"profile row 2 \(depth 5 m\): north is nan"),
        (lambda: Profile(depth=(-1.0, 5.0), north=(0.0, 0.0), east=(0.0, 0.0)),
         "row 1: depth -1 m is negative; depth is positive down"),
        (lambda: Profile(depth=(0.0, 5.0, 5.0), north=(0.0,) * 3, east=(0.0,) * 3),
         r"row 3: depth 5 m does not increase \(row before: 5 m\)"),
        (lambda: Profile(depth=(), north=(), east=()), "at least one depth"),
        (lambda: Profile(depth=(1.0,), north=(0.0, 1.0), east=(0.0,)), "2 north values for 1"),
        (lambda: LogLayer(friction_velocity=0.01, direction_deg=0, water_depth=-5), "water_depth"),
        (lambda: GaussMarkov(speed=0.1, direction_deg=0, speed_std=0.1, min_speed=3), "exceeds"),
        (lambda: GaussMarkov(speed=0.1, direction_deg=0, speed_std=0.1, seed=-1), "seed"),
        (lambda: Series(interval=0.0, north=(0.1,), east=(0.0,)), "interval must be greater than"),
        (lambda: Series(interval=60.0, north=(0.1, 0.2), east=(0.0,)), "2 values and east 1"),
        (lambda: parse_current("series:interval=60,north=0.1"), "east= is missing"),
        (lambda: Origin(latitude_deg=91.0), "latitude_deg must be within -88..88"),
        (lambda: Uniform().compile(0.0), "duration_s must be greater than 0 s"),
    ],
)  # fmt: skip
def test_bad_settings_are_named(build, message):
    with pytest.raises(CurrentError, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)


# --- from a line of text --------------------------------------------------------------------------


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
