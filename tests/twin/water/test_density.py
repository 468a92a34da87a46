"""Density profiles against TEOS-10 and against their own integral."""

import gsw
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from twin.errors import InputError
from twin.water.density import DensityProfile, density_at, gravity

LATITUDE = 36.8


def test_density_is_teos10():
    profile = DensityProfile.from_temperature_salinity(
        [0.0, 99.23839107], 10.0, 33.5, latitude=LATITUDE
    )
    assert profile.density(99.23839107) == pytest.approx(1026.238, abs=5e-4)


def test_gravity_is_teos10():
    assert gravity(LATITUDE, 99.238) == pytest.approx(9.79910, abs=5e-6)
    for latitude in (-90.0, 0.0, 45.0, 78.0):
        assert gravity(latitude, 500.0) == pytest.approx(
            gsw.grav(latitude, gsw.p_from_z(-500.0, latitude)), rel=1e-7
        )


def test_pressure_inverts_the_teos10_height_of_the_standard_ocean():
    """gsw's height is that of water of 35.16504 g/kg and 0 degC; integrate the same water."""
    depth = np.linspace(0.0, 1000.0, 201)
    p = gsw.p_from_z(-depth, LATITUDE)
    profile = DensityProfile(depth=depth, values=gsw.rho(35.16504, 0.0, p))
    # The last digits differ by gsw's polynomial fit of the specific volume.
    assert profile.pressure(depth, latitude=LATITUDE) == pytest.approx(p, abs=2e-3)


def test_pressure_of_constant_density_and_in_air():
    profile = DensityProfile.constant(1025.0)
    mean_gravity = gravity(LATITUDE, 50.0)
    got = profile.pressure([-1.0, 0.0, 100.0], latitude=LATITUDE)
    assert got[:2].tolist() == [0.0, 0.0]
    assert got[2] == pytest.approx(1025.0 * mean_gravity * 100.0 / 1e4, rel=1e-12)


def test_pressure_slope_is_the_weight_of_the_water():
    profile = DensityProfile.thermocline()
    z, h = np.array([800.3, 3.0, 47.7, 512.4]), 1e-2  # unsorted: the row search goes both ways
    slope = profile.pressure(z + h, latitude=LATITUDE) - profile.pressure(z - h, latitude=LATITUDE)
    weight = profile.density(z) * gravity(LATITUDE, z)
    assert slope * 1e4 / (2 * h) == pytest.approx(weight, rel=1e-6)


def test_thermocline_is_stably_stratified_below_its_mixed_layer():
    profile = DensityProfile.thermocline(mixed_layer_depth=40.0)
    assert np.all(np.diff(profile.values) > 0.0)
    # In a mixed layer density only grows by compression, rho g / c^2.
    sound = gsw.sound_speed_t_exact(gsw.SA_from_SP(33.4, 20.0, -121.8, LATITUDE), 16.0, 20.0)
    compression = profile.density(20.0) * gravity(LATITUDE) / sound**2
    step = np.diff(profile.values)
    assert step[:39] == pytest.approx(compression, rel=0.05)
    assert step[41:60].min() > 3 * compression


@settings(max_examples=60, deadline=None)
@given(
    values=st.lists(st.floats(1000.0, 1060.0), min_size=1, max_size=20),
    spacing=st.floats(0.1, 50.0),
    depth=st.floats(-20.0, 2000.0),
)
def test_compiled_profile_is_the_profile(values, spacing, depth):
    profile = DensityProfile(depth=np.arange(len(values)) * spacing, values=np.array(values))
    assert density_at(profile.compile(), depth) == pytest.approx(
        float(profile.density(depth)), rel=1e-12
    )


def test_uneven_table_compiles_to_its_interpolation():
    profile = DensityProfile(
        depth=np.array([5.0, 8.0, 20.0]), values=np.array([1020.0, 1026.0, 1027.2])
    )
    program = profile.compile()
    assert program[:2].tolist() == [21.0, 1.0]
    for z in (0.0, 5.0, 6.0, 8.0, 15.0, 20.0, 500.0):
        assert density_at(program, z) == pytest.approx(float(profile.density(z)))


def test_compiled_code_may_call_it_and_nan_stays_nan():
    @njit
    def caller(program, depth):
        return density_at(program, depth)

    program = DensityProfile.constant(1027.5).compile()
    assert caller(program, 300.0) == 1027.5
    assert np.isnan(density_at(program, np.nan))


@pytest.mark.parametrize(
    ("depth", "values", "message"),
    [
        ([0.0, np.nan], [1025.0, 1026.0], "depth is nan in row 1"),
        ([0.0, 5.0], [1025.0, np.nan], "density is nan in row 1"),
        ([-1.0, 5.0], [1025.0, 1026.0], "depth -1 m is negative"),
        ([0.0, 5.0, 5.0], [1025.0, 1026.0, 1027.0], "row 2 does not exceed"),
        ([0.0, 5.0], [25.0, 26.0], "sigma values need 1000 added"),
        ([0.0, 5.0], [1025.0], "two vectors of one length"),
    ],
)
def test_bad_tables_are_refused_in_one_line(depth, values, message):
    with pytest.raises(InputError, match=message) as error:
        DensityProfile(depth=np.array(depth), values=np.array(values))
    assert "\n" not in str(error.value)


def test_bad_casts_and_spacings_are_refused():
    with pytest.raises(InputError, match="salinity is nan in row 0"):
        DensityProfile.from_temperature_salinity([0.0], 10.0, np.nan)
    with pytest.raises(InputError, match="latitude 91"):
        DensityProfile.from_temperature_salinity([0.0], 10.0, 35.0, latitude=91.0)
    with pytest.raises(InputError, match="decay_depth is -3 m"):
        DensityProfile.thermocline(decay_depth=-3.0)
    with pytest.raises(InputError, match="larger spacing"):
        DensityProfile.thermocline().compile(spacing=0.01)
