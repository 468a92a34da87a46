"""Files of pyglider and basestation3 get what a flight model says, and keep all that they had."""

import functools
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from examples import needs_docs, run
from logs import SHARED

import glider_twin_pipelines
from factory.samples import Flight
from factory.samples.archives import write_og1, write_pyglider
from factory.samples.gliders import write_basestation
from glider_twin_pipelines import add_flight, add_flights, basestation3, times_of
from glider_twin_pipelines.__main__ import main
from glider_twin_pipelines.modelled_log import CURRENTS, POSITIONS, modelled
from twin.errors import InputError, WriteError
from twin.records.storage import whole
from twin.vehicle.presets import assets_folder

pytestmark = pytest.mark.filterwarnings("ignore:vertical water velocity")

FLIGHT = Flight(dives=3, depth=120.0)
W = "VERT_CURR_MODEL"
ADDED = {
    *POSITIONS, *CURRENTS, W, "GLIDER_SPEED_MODEL", "GLIDER_HORZ_VELO_MODEL",
    "GLIDER_VERT_VELO_MODEL", "GLIDER_SURGE_MODEL", "GLIDER_SWAY_MODEL", "ANGLE_OF_ATTACK_MODEL",
    "GLIDER_SPEED_SD_MODEL", "ANGLE_OF_ATTACK_SD_MODEL",
}  # fmt: skip


@pytest.fixture
def series(tmp_path):
    return write_pyglider(tmp_path / "dfo-eva099.nc", FLIGHT)


@pytest.fixture
def dives(tmp_path):
    return sorted(write_basestation(tmp_path, FLIGHT))


def content(path):
    """All that a file holds, as stored."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        held = {"": {name: str(file.getncattr(name)) for name in file.ncattrs()}}
        for name, variable in file.variables.items():
            about = {word: str(variable.getncattr(word)) for word in variable.ncattrs()}
            held[name] = (variable.dimensions, variable.dtype, about, variable[...].tobytes())
        return held


def read(path, name):
    with netCDF4.Dataset(path) as file:
        return np.ma.filled(np.ma.asarray(file[name][:], float), np.nan)


def test_a_time_series_gets_what_the_import_of_it_says(series):
    before = content(series)
    (wanted,) = modelled("ngdac", [series], "seaexplorer")
    assert add_flight(series, "seaexplorer") is True
    after = content(series)
    assert set(after) - set(before) == ADDED
    assert {name: after[name] for name in before} == before
    made = wanted.at(times_of(series))
    with netCDF4.Dataset(series) as file:
        for name in ADDED:
            np.testing.assert_allclose(read(series, name), made[name].values, atol=1e-6)
            about = {word: file[name].getncattr(word) for word in file[name].ncattrs()}
            assert file[name].dimensions == ("time",)
            assert about["coordinates"] == "depth latitude longitude"
            assert about["source"].endswith("flight model of vehicle seaexplorer")
            assert {"units", "long_name", "_FillValue"} <= set(about)
        assert file[W].standard_name == "upward_sea_water_velocity"
    # between the dives nothing is made up
    assert not np.isfinite(read(series, W)[FLIGHT.state(FLIGHT.time)["under"] == 0.0]).any()
    assert np.isfinite(read(series, "DAC_SD_MODEL")).sum() > 1000


def test_a_second_run_leaves_the_file_alone(series):
    add_flight(series, "seaexplorer")
    first, then = series.read_bytes(), series.stat().st_mtime_ns
    assert add_flight(series, "seaexplorer") is False
    assert series.read_bytes() == first
    assert series.stat().st_mtime_ns == then
    held = content(series)
    assert add_flight(series, "slocum-200") is True  # another vehicle's words take their place
    now = content(series)
    assert set(now) == set(held)
    assert now[W] != held[W]
    assert {n: now[n] for n in now if n not in ADDED} == {
        n: held[n] for n in held if n not in ADDED
    }
    assert add_flight(series, "seaexplorer") is True
    assert content(series) == held


def test_a_name_of_others_is_not_taken(series):
    with netCDF4.Dataset(series, "a") as file:
        file.createVariable("LATITUDE", "f8", ("time",))[:] = 49.0
    first = series.read_bytes()
    with pytest.raises(InputError, match="has LATITUDE already, which glider-twin did not write"):
        add_flight(series, "seaexplorer")
    assert series.read_bytes() == first


def test_a_write_that_fails_leaves_the_file_as_it_was(series, monkeypatch):
    first = series.read_bytes()

    def full(path):
        raise WriteError(f"no space left for {path}")

    monkeypatch.setattr(whole, "sync", full)
    with pytest.raises(WriteError, match="no space left"):
        add_flight(series, "seaexplorer")
    assert series.read_bytes() == first
    assert [one.name for one in series.parent.iterdir()] == [series.name]


def test_other_files_are_refused(series, dives, tmp_path):
    og1 = write_og1(tmp_path / "og1.nc", FLIGHT)
    for files, write, said in (
        ([og1], None, "is none of a time series of pyglider, a dive of basestation3"),
        ([series, series], None, "2 files at once"),
        ([series, *dives], None, "4 files at once"),
        (dives[:1], dives[1:], "is not one of the files that are read"),
        ([], None, "no file is not one"),
    ):
        with pytest.raises(InputError, match=said):
            add_flights(files, write=write)


def test_dives_are_read_together_and_only_the_new_are_written(dives):
    before = {path: content(path) for path in dives}
    assert add_flights(dives, write=dives[2:]) == dives[2:]
    assert [content(path) for path in dives[:2]] == [before[path] for path in dives[:2]]
    alone = shutil.copy(dives[1], dives[1].parent / "alone.nc")
    assert add_flights(dives) == dives[:2]
    assert add_flights(dives) == []
    for path in dives:
        after = content(path)
        assert set(after) - set(before[path]) == ADDED
        assert {name: after[name] for name in before[path]} == before[path]
    # the fixes of the neighbours make the track surer
    add_flights([Path(alone)])
    assert np.nanmean(read(dives[1], "POSITION_SD")) < np.nanmean(read(Path(alone), "POSITION_SD"))


@pytest.fixture
def told(monkeypatch):
    """The basestation's log, as its module BaseLog writes it."""
    lines = []
    module = types.SimpleNamespace()
    for level in ("error", "warning", "info"):
        tell = functools.partial(lambda level, line: lines.append((level, line)), level)
        setattr(module, f"log_{level}", tell)
    monkeypatch.setitem(sys.modules, "BaseLog", module)
    monkeypatch.setenv(basestation3.PYTHON, sys.executable)
    here = [str(Path(glider_twin_pipelines.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*here, str(Path(__file__).parents[3])]))
    return lines


def test_the_extension_adds_to_the_new_dives(dives, told):
    """As BaseDotFiles.process_extensions calls it; its interpreter has none of our packages."""
    before = [content(path) for path in dives]
    vehicle = dives[0].parent / basestation3.VEHICLE
    shutil.copy(assets_folder() / "seaglider.xml", vehicle)
    created = [dives[2], dives[0].parent / "sg999_timeseries.nc"]
    options = types.SimpleNamespace(mission_dir=dives[0].parent)
    words = {"dive_nc_file_names": [*map(str, dives)], "known_ftp_tags": []}
    assert basestation3.main(base_opts=options, nc_files_created=created, **words) == 0
    assert told[-1] == ("info", "glider-twin: 1 of 1 files changed")
    assert [content(path) for path in dives[:2]] == before[:2]
    with netCDF4.Dataset(dives[2]) as file:
        assert file[W].source.endswith("flight model of vehicle glider_twin")
    # a mission's section, and a call of its own, add to all
    assert basestation3.main(base_opts=options) == 0
    assert told[-1] == ("info", "glider-twin: 2 of 3 files changed")
    assert basestation3.load_additional_arguments() == (["mission_dir"], {}, {})


def test_the_extension_tells_what_fails(dives, told, monkeypatch, tmp_path):
    options = types.SimpleNamespace(mission_dir=tmp_path)
    shutil.copy(__file__, tmp_path / basestation3.VEHICLE)
    assert basestation3.main(base_opts=options) == 1
    assert told[-1][0] == "error"
    assert "glider_twin.xml" in told[-1][1]
    monkeypatch.setenv(basestation3.PYTHON, str(tmp_path / "none"))
    assert basestation3.main(base_opts=options) == 1
    assert "set GLIDER_TWIN_PYTHON" in told[-1][1]
    empty = types.SimpleNamespace(mission_dir=tmp_path / "empty")
    assert basestation3.main(base_opts=empty) == 0
    assert told[-1] == ("info", "glider-twin: no dive to add to")


def test_the_extension_reads_the_dives_before_the_new(told, monkeypatch, tmp_path):
    for number in range(1, 41):
        (tmp_path / f"p999{number:04d}.nc").touch()
    (tmp_path / "p9990038_early.nc").touch()
    asked = []

    def answer(words, **_):
        asked.append([Path(word).name for word in words])
        return types.SimpleNamespace(returncode=0, stdout="", stderr="")

    monkeypatch.setattr(subprocess, "run", answer)
    options = types.SimpleNamespace(mission_dir=tmp_path)
    created = [tmp_path / f"p99900{number}.nc" for number in (38, 37)]
    assert basestation3.main(base_opts=options, nc_files_created=created) == 0
    read = [f"p999{number:04d}.nc" for number in range(37 - basestation3.BEFORE, 41)]
    start = [Path(sys.executable).name, "-P", "-m", "glider_twin_pipelines"]
    assert asked == [[*start, *read, "--write", "p9990038.nc", "p9990037.nc"]]


def test_it_finds_the_interpreter_of_its_environment(monkeypatch, tmp_path):
    monkeypatch.delenv(basestation3.PYTHON, raising=False)
    place = tmp_path / "lib" / "python3.12" / "site-packages" / "glider_twin_pipelines"
    monkeypatch.setattr(basestation3, "__file__", str(place / "basestation3.py"))
    assert basestation3.interpreter() == str(tmp_path / "bin" / "python")


def test_the_extension_needs_the_library_of_python_alone(tmp_path):
    """As the basestation loads it: by its path, in an interpreter without our packages."""
    place = tmp_path / "site-packages" / "glider_twin_extension.py"
    place.parent.mkdir()
    shutil.copy(basestation3.__file__, place)
    code = "import sys; sys.path.append(sys.argv[1]); import glider_twin_extension"
    subprocess.run([sys.executable, "-I", "-S", "-c", code, str(place.parent)], check=True)


def test_the_command(series, capsys):
    assert main([str(series), "--vehicle", "seaexplorer"]) == 0
    said = capsys.readouterr()
    assert said.out == "1 of 1 files changed\n"
    assert "the vehicle seaexplorer does not fit the log" in said.err
    assert main([str(series), "--vehicle", "submarine"]) == 1
    assert "submarine" in capsys.readouterr().err


@needs_docs
def test_the_page_runs(series, tmp_path, monkeypatch):
    (tmp_path / "L0-timeseries").mkdir()
    path = series.rename(tmp_path / "L0-timeseries" / "dfo-eva035-20190718.nc")
    shutil.copy(assets_folder() / "seaexplorer.xml", tmp_path / "mine.xml")
    monkeypatch.chdir(tmp_path)
    run("docs/howto/pipelines.md")
    with netCDF4.Dataset(path) as file:
        assert file[W].source.endswith("flight model of vehicle mine")


REAL = SHARED / "seaglider_apl_basestation3" / "p2490010.nc"


@pytest.mark.skipif(not REAL.is_file(), reason="needs a real Seaglider's dive, which is not here")
def test_a_real_dive_of_basestation3(tmp_path):
    path = Path(shutil.copy(REAL, tmp_path))
    before = content(path)
    assert add_flights([path]) == [path]
    assert add_flights([path]) == []
    after = content(path)
    assert {name: after[name] for name in before} == before
    # the basestation's own current, by another flight model
    for axis in ("north", "east"):
        own = float(read(path, f"depth_avg_curr_{axis}"))
        assert abs(np.nanmean(read(path, f"DAC_{axis.upper()}_MODEL")) - own) < 0.03
