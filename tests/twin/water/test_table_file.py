"""Tables with another separator than the comma are refused with the way out."""

import pytest

from twin.errors import CurrentError, InputError, MissionError
from twin.mission import load_mission
from twin.water.current import Profile
from twin.water.density import read_density_csv

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
