"""Tables with another separator than the comma are refused with the way out."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.errors import CurrentError, InputError, MissionError
from twin.mission import load_mission
from twin.water.current import Profile
from twin.water.density_spec import read_density_csv

SEPARATORS = [(";", "semicolons"), ("\t", "tabs"), (" ", "blanks")]


@pytest.mark.parametrize(("separator", "word"), SEPARATORS)
def test_a_current_profile_must_have_commas(tmp_path: Path, separator: str, word: str) -> None:
    path = tmp_path / "profile.csv"
    path.write_text("# a comment; with\tall\ndepth,north,east\n0,0.1,0\n".replace(",", separator))
    with pytest.raises(CurrentError, match=f"profile.csv line 2: .*by {word}; .*by commas.*point"):
        Profile.from_csv(path)


@pytest.mark.parametrize(("separator", "word"), SEPARATORS)
def test_a_density_profile_must_have_commas(tmp_path: Path, separator: str, word: str) -> None:
    path = tmp_path / "density.csv"
    path.write_text("depth,density\n0,1025\n".replace(",", separator))
    with pytest.raises(InputError, match=f"density.csv line 1: .*by {word}; .*by commas.*point"):
        read_density_csv(path)


def test_a_decimal_comma_is_found_where_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "profile.csv"
    path.write_text("depth,north,east\n0;0,1;0,2\n")
    with pytest.raises(CurrentError, match="line 2: columns are separated by semicolons"):
        Profile.from_csv(path)


def test_blanks_around_commas_and_comments_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "profile.csv"
    path.write_text("# from a cast; 3 May\ndepth, north,\teast\n 0, 0.1, 0\n10, 0.2, 0.1 \n")
    assert Profile.from_csv(path).north == (0.1, 0.2)
    path = tmp_path / "density.csv"
    path.write_text("# from a cast; 3 May\ndepth,density\n0,1025\n\n10, 1026\n")
    assert read_density_csv(path).values.tolist() == [1025.0, 1026.0]


def test_a_profile_without_header_is_told(tmp_path: Path) -> None:
    path = tmp_path / "profile.csv"
    path.write_text("0,0.1,0\n10,0.2,0\n")
    with pytest.raises(CurrentError, match="begins with numbers: write the header depth,north"):
        Profile.from_csv(path)


@pytest.mark.parametrize("separator", ";,\t")
def test_a_table_is_no_mission(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "mission.csv"
    path.write_text("kind,max_depth_m\nsaw-tooth,100\n".replace(",", separator))
    with pytest.raises(MissionError, match=r"no table of columns but \[\[segments\]\]"):
        load_mission(path)
