"""Tracks in CSV files: names, missions, padding, and what is wrong with a file."""

import pytest

from twin.errors import InputError
from twin.records.tracks import read_tracks

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
