"""The command line: what each command says, and what it says about bad input."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from patience import little_work

import factory
from factory.__main__ import PROGRAM
from factory.commands.generate import BLAS_THREADS
from factory.generation.generated_store import GeneratedStore
from factory.sampling.draw import check_room
from factory.sampling.presets import read_changes
from factory.sampling.recipe import make_recipe
from twin.__main__ import PROGRAM as TWIN
from twin.cli.text_table import WIDEST
from twin.errors import InputError
from twin.records.schema import SIMULATED
from twin.records.store import write_zarr

QUICK = ["--hours", "0.1", "--workers", "1"]


def run(capsys, *words):
    code = PROGRAM.main([str(word) for word in words])
    said = capsys.readouterr()
    return code, said.out, said.err


def answer(capsys, *words):
    code, out, err = run(capsys, *words, "--json")
    assert code == 0, err
    result = json.loads(out)
    return result


def test_generate_info_verify_replay_plot_export_in_a_row(tmp_path, capsys):
    store = tmp_path / "missions.zarr"
    made = answer(capsys, "generate", *QUICK, "--out", store, "--seed", 4)
    assert made["missions"] == made["flown"] == 3
    assert made["hours"] == pytest.approx(0.1)
    assert made["stored_bytes"] == sum(p.stat().st_size for p in store.rglob("*") if p.is_file())
    code, out, _ = run(capsys, "info", store)
    assert code == 0
    assert re.search(r"mission\.pitch_deg +degree +uniform\(15, 45\)", out)  # folded behind it
    assert max(map(len, out.partition("drawn")[2].splitlines())) <= WIDEST
    assert "1 test" not in out
    info = answer(capsys, "info", store)
    assert info["settings"]["seed"] == 4
    assert {row["split"] for row in info["splits"]} == {"train", "validation", "test"}
    assert answer(capsys, "verify", store)["ok"] is True
    replayed = answer(capsys, "verify", store, "--replay", 0, 2)
    assert replayed["identical"] is True
    assert [mission["mission"] for mission in replayed["missions"]] == [0, 2]
    assert answer(capsys, "plot", store)["out"] == str(store.with_suffix(".png"))
    exported = answer(capsys, "export", store, "--to", "og1", "--mission", 1)
    assert len(list(Path(exported["out"]).glob("*.nc"))) == 1
    again = ("export", store, "--to", "parquet", "--mission", 1, "--out", tmp_path / "one.parquet")
    assert "wrote 1 mission to " in run(capsys, *again)[1]
    code, _, err = run(capsys, "generate", *QUICK, "--out", store, "--seed", 4, "--resume")
    assert code == 0
    assert "already complete" in err


@pytest.fixture(scope="module")
def no_missions(paper_store, tmp_path_factory):
    """A store whose missions were all taken out."""
    path = tmp_path_factory.mktemp("none") / "none.zarr"
    with xr.open_zarr(paper_store, chunks=None) as whole:
        none = whole.isel(mission=slice(0, 0)).load().drop_encoding()
    write_zarr(none, path)
    return path


@pytest.mark.parametrize(
    "words",
    [
        *("factory info", "factory verify", "factory plot", "factory verify --replay 0"),
        *("factory export --to parquet", "twin plot", "twin render --html none.html"),
        "twin view --web",
    ],
)
def test_a_store_without_missions_is_told(words, no_missions, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program, name, *options = words.split()
    code = {"factory": PROGRAM, "twin": TWIN}[program].main([name, str(no_missions), *options])
    said = capsys.readouterr()
    assert code == 2
    assert f"{no_missions} holds no missions; make some with `factory generate`" in said.err
    assert list(tmp_path.iterdir()) == []


def test_overrides_come_from_a_file_and_from_words_which_win(tmp_path, capsys):
    config = tmp_path / "spread.toml"
    config.write_text('[mission]\npitch_deg = "uniform(20, 22)"\n[current]\nspeed = 0.1\n')
    store = tmp_path / "missions.zarr"
    words = ["generate", *QUICK, "--out", store, "--config", config]
    code, _, err = run(
        capsys, *words, "--set", "current.speed=uniform(0.01,0.02)", "mission.kind=spiral"
    )
    assert code == 0, err
    made = GeneratedStore(store)
    pitch, speed = made.array("mission_pitch_deg"), made.array("current_speed")
    assert ((pitch >= 20) & (pitch <= 22) | (pitch != pitch)).all()
    assert ((speed >= 0.01) & (speed <= 0.02)).all()
    assert set(made.array("mission_kind").ravel().tolist()) <= {1, -1}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("generate --hours 0", "--hours 0 must be above 0"),
        ("generate --hours -2", "--hours -2 must be above 0"),
        ("generate --hours nan", "--hours nan is not a number"),
        ("generate --hours 1e12", "--hours 1e+12 would need about 4e+08 GB"),
        ("generate --hours inf", "would need about inf GB"),
        ("generate --hours 0.001", "give at least 0.05"),
        ("generate --preset feild", "unknown preset 'feild': did you mean 'field'?"),
        ("generate --seed -1", "--seed -1 must be at least 0"),
        ("generate --set mission.pitch=30", "did you mean 'mission.pitch_deg'?"),
        ("generate --set mission.pitch_deg", "write NAME=DISTRIBUTION"),
        ("generate --set mission.pitch_deg=unifrom(1,2)", "did you mean 'uniform'?"),
        ("generate --sensors feild", "did you mean 'field'?"),
        ("generate --vehicle glidr", "did you mean 'glider'?"),
        ("generate --current unifrm:1,2", "did you mean 'uniform'?"),
        ("generate --current uniform:0.1,0 --set current.speed=0.2", "do not set current.speed"),
        ("generate --preset paper-test --hours 3", "leave --hours out"),
        ("generate --config none.toml", "cannot read parameter file none.toml"),
        ("generate --hour 3", "did you mean --hours (simulated time"),
        ("verify none.zarr --replay 0", "no store at none.zarr"),
        ("verify none.zarr --attempt 0", "--attempt is of a mission: give --replay"),
        ("repair none.zarr", "repair"),
        ("verify none.zarr", "no store at none.zarr"),
        ("info none.zarr", "no store at none.zarr"),
        ("plot none.zarr", "no store at none.zarr"),
        ("export none.zarr --to og1", "no store at none.zarr"),
        ("export none.zarr --to csv", "mcap, og1, parquet"),
    ],
)
def test_bad_input_is_one_line_and_touches_nothing(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *words.split())
    assert code == 2
    assert message in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_store_exits_with_1_and_names_the_chunk(tmp_path, capsys):
    store = tmp_path / "missions.zarr"
    run(capsys, "generate", *QUICK, "--out", store)
    shard = store / "true_heave" / "c" / "0" / "0"
    data = bytearray(shard.read_bytes())
    data[200] ^= 1
    shard.write_bytes(bytes(data))
    code, out, err = run(capsys, "verify", store)
    assert code == 1
    assert "true_heave of mission 0 cannot be read" in out
    assert "NOT sound" in out
    assert "Traceback" not in err
    code, _, err = run(capsys, "verify", store, "--replay", 0)
    assert code == 2
    assert "true_heave of mission 0 cannot be read" in err


def a_pipe(path):
    os.mkfifo(path)
    return "it is a named pipe, not a file"


def a_device(path):
    path.symlink_to("/dev/zero")
    return "it is a link to a device, not a file"


def giant(path):
    with path.open("wb") as file:
        file.truncate(2**40)
    return f"has {2**40} bytes"


@pytest.mark.parametrize("make", [a_pipe, a_device, giant])
@pytest.mark.parametrize("key", ["true_heave/c/0/0", "n_samples/c/0", "time/zarr.json"])
@pytest.mark.parametrize("listed", [True, False])
@little_work(20.0)
def test_a_file_of_a_store_without_an_end_is_named_and_not_read(
    make, key, listed, tmp_path, capsys, copied
):
    if not listed:
        shutil.rmtree(copied / "checksums")
    (copied / key).unlink()
    why = make(copied / key)
    for program, words in (
        (TWIN, ("plot", copied, "--out", tmp_path / "a.png")),
        (PROGRAM, ("info", copied)),
    ):
        assert program.main([str(word) for word in words]) == 2
        told = capsys.readouterr().err
        assert key in told
        assert why in told
    code, out, err = run(capsys, "verify", copied)
    assert code == (1 if listed else 2)
    assert key in (out if listed else err)


def test_files_of_a_store_may_be_links(paper_store, capsys, copied):
    for key in ("true_heave/c/0/0", "n_samples/c/0"):
        (copied / key).unlink()
        (copied / key).symlink_to(paper_store / key)
    assert run(capsys, "verify", copied)[0] == 0


def test_distributions_lists_the_whole_table(capsys):
    code, out, _ = run(capsys, "distributions", "--preset", "field")
    assert code == 0
    for parameter in factory.parameters().values():
        assert parameter.name in out
    shown = answer(capsys, "distributions", "--set", "mission.yos=2")
    assert shown["distributions"]["mission.yos"] == "2"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pitch_deg = 3", "must be a table"),
        ("[mission]\npitch_deg = [1, 2]", "give a number or a text"),
        ("[mission", "is not TOML"),
    ],
)
def test_bad_config_files_are_told(tmp_path, text, message):
    path = tmp_path / "spread.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_changes(path)


def test_float32_size_counts_every_sample_of_every_signal():
    recipe = make_recipe(hours=0.2)
    samples = sum(round(duration / 0.5) + 1 for duration in recipe.plan.durations_s)
    assert recipe.float32_bytes == 4 * len(SIMULATED) * samples


def test_generating_leaves_the_environment_as_it_was(tmp_path, monkeypatch):
    monkeypatch.delenv(BLAS_THREADS, raising=False)
    code = PROGRAM.main(["generate", "--hours", "0.06", "--out", str(tmp_path / "s.zarr")])
    assert code == 0
    assert BLAS_THREADS not in os.environ


def test_generating_imports_no_library_that_it_does_not_need(tmp_path):
    """They cost half a second, as much as flying three hours."""
    code = (
        "import sys; from factory.__main__ import PROGRAM;"
        f"code = PROGRAM.main(['generate', '--hours', '0.06', '--out', {str(tmp_path / 's')!r}]);"
        "heavy = {'xarray', 'pandas', 'matplotlib', 'torch', 'gsw', 'netCDF4',"
        "'scipy.signal', 'scipy.optimize', 'scipy.integrate', 'dm_control'};"
        "sys.exit(code or ', '.join(sorted(heavy & set(sys.modules))) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_hours_that_the_disk_cannot_hold_are_refused(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1_000_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    check_room(2000.0, tmp_path / "not" / "yet" / "there.zarr")
    with pytest.raises(InputError, match=r"--hours 3000 needs about 1\.2 GB, .* has 1 GB free"):
        check_room(3000.0, tmp_path / "not" / "yet" / "there.zarr")


def test_a_store_that_is_named_by_a_dot(tmp_path, capsys, monkeypatch):
    """What is written goes beside the folder; where there is none, that is said."""
    pytest.importorskip("pyarrow")
    empty = tmp_path / "empty"
    empty.mkdir()
    store = tmp_path / "missions.zarr"
    answer(capsys, "generate", *QUICK, "--out", store)
    for command in (["plot", "."], ["export", ".", "--to", "parquet"]):
        monkeypatch.chdir(empty)
        code, _, err = run(capsys, *command)
        assert code == 2
        assert err.startswith("factory: error: . is an empty folder, not a store of missions")
        assert len(err.splitlines()) == 1
        monkeypatch.chdir(store)
        code, _, err = run(capsys, *command)
        assert code == 0, err
    assert {path.name for path in tmp_path.iterdir()} == {
        "empty", "missions.zarr", "missions.zarr.log", "missions.png", "missions.parquet"
    }  # fmt: skip
