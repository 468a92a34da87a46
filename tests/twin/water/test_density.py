"""Density profiles against TEOS-10 and their integral; tables in files."""

import gsw
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from twin.errors import CurrentError, InputError, MissionError
from twin.mission import load_mission
from twin.water.current import Profile
from twin.water.density import DensityProfile, density_at, gravity, read_density_csv

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


# --- tables in files ------------------------------------------------------------------------------


READERS = {
    "density.csv": ("depth,density\n0,1025\n", read_density_csv),
    "profile.csv": ("depth,north,east\n0,0.1,0\n", Profile.from_csv),
}


@pytest.mark.parametrize(
    ("separator", "word"), [(";", "semicolons"), ("\t", "tabs"), (" ", "blanks")]
)
@pytest.mark.parametrize("name", READERS)
def test_a_table_must_have_commas(tmp_path, name, separator, word):
    text, read = READERS[name]
    path = tmp_path / name
    path.write_text("# a comment; with\tall\n" + text.replace(",", separator))
    with pytest.raises(InputError, match=f"{name} line 2: .*by {word}; .*by commas.*point"):
        read(path)


def test_a_decimal_comma_is_found_where_it_stands(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("depth,north,east\n0;0,1;0,2\n")
    with pytest.raises(CurrentError, match="line 2: columns are separated by semicolons"):
        Profile.from_csv(path)


def test_blanks_around_commas_and_comments_are_fine(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("# from a cast; 3 May\ndepth, north,\teast\n 0, 0.1, 0\n10, 0.2, 0.1 \n")
    assert Profile.from_csv(path).north == (0.1, 0.2)
    path = tmp_path / "density.csv"
    path.write_text("# from a cast; 3 May\ndepth,density\n0,1025\n\n10, 1026\n")
    assert read_density_csv(path).values.tolist() == [1025.0, 1026.0]


def test_a_profile_without_header_is_told(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("0,0.1,0\n10,0.2,0\n")
    with pytest.raises(CurrentError, match="begins with numbers: write the header depth,north"):
        Profile.from_csv(path)


@pytest.mark.parametrize("separator", ";,\t")
def test_a_table_is_no_mission(tmp_path, separator):
    path = tmp_path / "mission.csv"
    path.write_text("kind,max_depth_m\nsaw-tooth,100\n".replace(",", separator))
    with pytest.raises(MissionError, match=r"not a table of columns but \[\[segments\]\]"):
        load_mission(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "density.csv is empty"),
        ("# nothing but words\n", "density.csv is empty"),
        ("depth,density\n", "density.csv has no rows"),
        ("depth,dens\n0,1025\n", "lacks the column 'temperature'"),
        ("depth,density,density\n0,1025,1026\n", "more than one column 'density'"),
        ("# cast\ndepth,density\n0,1025\n\n10,heavy\n", "row 5: density is 'heavy', not a number"),
        ("depth,density\n0,1025,7\n", "row 2: 3 values, the header has 2"),
        ("depth,density\n0,1025\n10\n", "row 3: 1 values, the header has 2"),
    ],
)
def test_a_density_file_that_is_wrong_says_where(tmp_path, text, message):
    path = tmp_path / "density.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_density_csv(path)
    assert "density.csv" in str(caught.value)


def test_numbers_keep_every_bit(tmp_path):
    path = tmp_path / "density.csv"
    path.write_text('"depth","density"\n0.1,1025.0000000000002\n0.30000000000000004,1026\n')
    profile = read_density_csv(path)
    assert profile.depth.tolist() == [0.1, 0.30000000000000004]
    assert profile.values.tolist() == [1025.0000000000002, 1026.0]


def test_a_table_of_more_lines_than_any_sea_has_metres_is_refused_before_it_is_split(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("twin.water.table_file.MOST_ROWS", 3)
    path = tmp_path / "density.csv"
    path.write_text("depth,density\n0,1025\n10,1026\n")
    assert len(read_density_csv(path).depth) == 2
    path.write_text("\n" * 4)
    with pytest.raises(InputError, match=r"has 4 lines, more than 3: average them over depth"):
        read_density_csv(path)
