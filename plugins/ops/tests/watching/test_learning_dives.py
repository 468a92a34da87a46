"""Dives that tell most, as files beside a deployment."""

import json
import shutil

import pytest

from factory.samples import Flight
from factory.samples.gliders import write_basestation, write_slocum
from glider_twin_ops.files import read_commands
from glider_twin_ops.watching import propose_learning
from glider_twin_ops.watching.log_of_files import log_of_files
from twin.errors import InputError
from twin.mission import read_slocum

MISSION = "\n".join(
    f"behavior: {name}\n    b_arg: args_from_file(enum) 10"
    for name in ("surface", "goto_list", "yo")
)


def test_a_slocum_gets_argument_files_and_the_twin_s_flight_of_them(tmp_path, watched, run):
    made = watched(vehicle="slocum-200")
    with pytest.raises(InputError, match=r"has no log\.zarr yet"):
        propose_learning(made)
    write_slocum(tmp_path / "arrived", Flight(dives=3))
    log_of_files(made, made.folder)
    for _ in range(2):  # the second takes the place of the first
        code, said, err = run(made.folder, "--to-learn", "--json")
        assert code == 0, err
    answer = json.loads(said)
    assert answer["after_proposed"] < answer["after_usual"]
    for k, one in enumerate(answer["dives"], 1):
        folder = made.folder / "learn" / str(k)
        assert sorted(path.name for path in folder.iterdir()) == [
            "dive.txt", "goto_l10.ma", "surfac10.ma", "yo10.ma",
        ]  # fmt: skip
        shutil.copytree(folder, tmp_path / f"sent{k}")
        (tmp_path / f"sent{k}" / "learn.mi").write_text(MISSION)
        (segment,) = read_slocum(tmp_path / f"sent{k}" / "learn.mi").mission.segments
        assert one["words"].startswith(f"pitch {segment.pitch_deg:.0f} degree")
        assert one["by_hand"] == ""
        # it comes up when the surfacing file says, or at the end of the yo that it is in
        late = one["flight"]["min"] * 60.0 - segment.surface_after_s
        assert -60.0 < late < 0.6 * segment.surface_after_s
        assert f"{one['flight']['km']:g} km" in (folder / "dive.txt").read_text()


def test_a_seaglider_gets_commands_and_what_they_cannot_say_is_said(watched, source):
    made = watched(vehicle="seaglider")
    write_basestation(source, Flight(dives=3))
    log_of_files(made, made.folder)
    found = propose_learning(made)
    for k, one in enumerate(found.dives, 1):
        assert list(one.files) == ["targets", "cmdfile"]
        commands = read_commands(made.folder / "learn" / str(k) / "cmdfile")
        # the pump below comes on top of the glides that $T_DIVE counts, and must not end the dive
        assert commands["T_DIVE"] < one.flight["min"] < commands["T_MISSION"]
        said = (made.folder / "learn" / str(k) / "dive.txt").read_text()
        assert "its files have no climb" in said
