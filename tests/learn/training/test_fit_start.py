"""The start of a fit: what it checks and leaves when it fails, and how a run is gone on with."""

import errno
import json
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from learn_missions import write_synthetic_store
from patience import HANG_S

import learn.training.workers
from learn.__main__ import PROGRAM
from learn.files import write_sealed
from learn.networks.base import NetworkConfig
from learn.run import METRICS, Run, newest_run, open_run, read_description
from learn.run_folder import training_folder
from learn.training.fit_config import FitConfig
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from twin.cli.console import to_json
from twin.errors import InputError, StoreError, WriteError

QUICK = ("--epochs", "1", "--hidden", "4", "--layers", "1", "--members", "1", "--workers", "1")


def call(capsys, *words):
    code = PROGRAM.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def small_config(store, **changes):
    return FitConfig(
        store=str(store),
        features=("sin_pitch", "depth_rate"),
        network=NetworkConfig(hidden=4, layers=1),
        training=TrainingConfig(epochs=1, seconds=0.0),
        **changes,
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a store, and a run of it that is trained and not judged."""
    folder = tmp_path_factory.mktemp("start")
    store = write_synthetic_store(folder / "s.zarr", [300, 280, 260], [0, 0, 1])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        fit(small_config("s.zarr"), folder / "runs" / "done")
    assert store.exists()
    return folder


@pytest.fixture
def here(place, tmp_path, monkeypatch):
    """A copy of it, so that tests may break it."""
    shutil.copytree(place, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr("learn.finishing.finish", lambda run, **_: run)
    monkeypatch.setattr("learn.report.tell_report", lambda *_: None)
    return tmp_path / "here"


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nothere.zarr",), "no store at nothere.zarr"),
        (("s.zarr", "--without", "attitud"), "did you mean 'attitude'"),
        (("s.zarr", "--epochs", "-1"), "must not be negative"),
        (("s.zarr", "--workers", "-2"), "workers must be at least 1"),
        (("s.zarr", "--period", "0.7"), "no multiple"),
        (("s.zarr", "--device", "cuda"), "no CUDA device is available"),
        (("s.zarr", "--start", "none"), "is not a run"),
        (("s.zarr", "--start", "none", "--inputs", "glider"), "is not a run"),
        (("s.zarr", "--period", "nan"), "period must be a finite number"),
        (("s.zarr", "--period", "-1"), "period must be a finite number"),
        (("s.zarr", "--seconds", "nan"), "seconds must be a finite number, not nan"),
        (("s.zarr", "--seconds", "inf"), "seconds must be a finite number, not inf"),
        (
            ("s.zarr", "--network", "elman", "--window", "1000000"),
            "the longest, mission 0, has 300 samples",
        ),
        (("s.zarr", "--hidden", "99999999"), "hidden must be at most 4096"),
        (("s.zarr", "--layers", "99999999"), "layers must be at most 64"),
        (("s.zarr", "--delays", "99999999"), "delays must be at most 256"),
        (
            ("s.zarr", "--network", "elman", "--hidden", "4096", "--delays", "256"),
            "take fewer units",
        ),
        (("s.zarr", "--memory", "0"), "--memory 0 must be a number of GB above 0"),
        (("s.zarr", "--memory", "0.0001"), "streaming the training data takes 0.11 GB"),
        (("s.zarr", "--buffer", "0"), "training buffer must be at least 1"),
    ],
)
def test_a_start_that_cannot_be_leaves_the_old_run(here, capsys, monkeypatch, words, message):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    before = contents(here)
    code, _, err = call(capsys, "fit", *words, "--name", "done", "--overwrite")
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert contents(here) == before


def test_without_tensorboard_the_old_run_stays_and_the_package_is_named(here, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    before = contents(here)
    words = ("fit", "s.zarr", "--name", "done", "--overwrite", "--tensorboard")
    code, _, err = call(capsys, *words)
    assert code == 2
    assert "pip install tensorboard" in err
    assert contents(here) == before


def test_events_are_written_into_a_new_run(here, capsys):
    pytest.importorskip("tensorboard")
    code, _, err = call(capsys, "fit", "s.zarr", "--name", "events", "--tensorboard", *QUICK)
    assert code == 0, err
    (events,) = (here / "runs" / "events" / "events").iterdir()
    assert b"surge-0/validation_mse" in events.read_bytes()


def test_a_run_is_replaced_once_the_new_one_is_trained(here, capsys):
    (here / "runs" / "done" / "README.md").write_text("old")
    code, _, err = call(capsys, "fit", "s.zarr", "--name", "done", "--overwrite", *QUICK)
    assert code == 0, err
    assert not (here / "runs" / "done" / "README.md").exists()
    assert [p.name for p in (here / "runs").iterdir()] == ["done"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, StoreError("no"), MemoryError])
def test_a_start_that_ends_before_training_leaves_the_old_run(here, monkeypatch, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("learn.training.workers.train", fail)
    before = contents(here)
    with pytest.raises(type(error) if isinstance(error, Exception) else error) as caught:
        fit(small_config("s.zarr"), here / "runs" / "done", replace=True)
    assert contents(here) == before
    assert [p.name for p in (here / "runs").iterdir()] == ["done"]
    if error is KeyboardInterrupt:
        assert "nothing was trained yet" in str(caught.value)
        assert "is as it was" in str(caught.value)


@pytest.mark.parametrize("file", [None, "runs/new/surge-0.safetensors"])
def test_a_disk_that_is_full_is_told_with_the_run(here, monkeypatch, file):
    """The system names no file when a write fails, and one when it cannot be opened."""

    def fail(*_, **__):
        error = OSError(errno.ENOSPC, "No space left on device")
        error.filename = file and str(here / file)
        raise error

    monkeypatch.setattr("learn.training.workers.train", fail)
    with pytest.raises(WriteError, match=r"cannot write .*runs/new: No space left"):
        fit(small_config("s.zarr"), here / "runs" / "new")


def test_a_file_of_something_else_is_not_told_as_the_runs(here, monkeypatch):
    def fail(*_, **__):
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "/nowhere/else")

    monkeypatch.setattr("learn.training.workers.train", fail)
    with pytest.raises(FileNotFoundError):
        fit(small_config("s.zarr"), here / "runs" / "new")


def test_a_name_stays_free_when_nothing_was_trained(here, capsys):
    def poke(arrays):
        arrays["measured_pitch"][1, 12] = float("nan")

    write_synthetic_store(here / "nan.zarr", [300, 280], [0, 0], edit=poke)
    write_synthetic_store(here / "less.zarr", [300, 280], [0, 0], drop=("measured_pump",))
    for store, message in (("nan.zarr", "measured_pitch"), ("less.zarr", "measured_pump")):
        code, _, err = call(capsys, "fit", store, "--name", "free", *QUICK)
        assert code == 2
        assert message in err
        assert "learn fit --without " in err
        assert not (here / "runs" / "free").exists()


def interrupted_in_sway(monkeypatch, compiled=False):
    """Ends a fit after surge is trained, in compiled code by a SystemError."""
    real = learn.training.workers.train

    def train(job, folder, report, **options):
        if job.target == "sway" and compiled:
            raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
        if job.target == "sway":
            raise KeyboardInterrupt
        return real(job, folder, report, **options)

    monkeypatch.setattr("learn.training.workers.train", train)


@pytest.mark.parametrize("compiled", [False, True])
def test_an_interrupt_after_training_began_keeps_what_is_trained(here, monkeypatch, compiled):
    with monkeypatch.context() as patch:
        interrupted_in_sway(patch, compiled)
        with pytest.raises(KeyboardInterrupt, match="`learn fit --name new --resume`"):
            fit(small_config("s.zarr"), here / "runs" / "new")
    assert (here / "runs" / "new" / "surge-0.json").is_file()
    with pytest.raises(StoreError, match="`learn fit --name new --resume`"):
        open_run("new")


def test_the_old_run_stays_until_its_replacement_is_trained(here, capsys, monkeypatch):
    """An interrupted replacement is nobody's run, and is continued by its settings."""
    folder = here / "runs" / "done"
    before = contents(folder)
    with monkeypatch.context() as patch:
        interrupted_in_sway(patch)
        with pytest.raises(KeyboardInterrupt, match="`learn fit --name done --overwrite --resume`"):
            fit(small_config("s.zarr", members=2), folder, replace=True)
    assert contents(folder) == before
    assert newest_run().folder.name == "done"
    surge = (training_folder(folder, replace=True) / "surge-0.safetensors").read_bytes()
    words = ("fit", "--name", "done", "--overwrite", "--resume", "--workers", "1")
    code, _, err = call(capsys, *words)
    assert code == 0, err
    assert open_run("done").members == 2
    assert (folder / "surge-0.safetensors").read_bytes() == surge
    assert [p.name for p in (here / "runs").iterdir()] == ["done"]


def test_a_replacement_that_is_started_again_forgets_the_first(here, monkeypatch):
    folder = here / "runs" / "done"
    with monkeypatch.context() as patch:
        interrupted_in_sway(patch)
        with pytest.raises(KeyboardInterrupt):
            fit(small_config("s.zarr", members=2), folder, replace=True)
    fit(small_config("s.zarr"), folder, replace=True)
    assert sorted(p.stem for p in folder.glob("*.safetensors")) == ["surge-0", "sway-0"]


def test_a_kill_between_training_and_saving_costs_nothing(here, monkeypatch):
    """The checkpoint stays until the network is saved."""
    folder = here / "runs" / "new"

    def fail(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("learn.networks.predictor.Predictor.save", fail)
        with pytest.raises(KeyboardInterrupt):
            fit(small_config("s.zarr"), folder)
    lines = (folder / METRICS).read_bytes()
    fit(small_config("s.zarr"), folder, resume=True)
    assert b'"surge-0"' not in (folder / METRICS).read_bytes()[len(lines) :]
    assert (folder / "surge-0.safetensors").is_file()
    assert not list(folder.glob("*.checkpoint"))


def test_two_fits_of_one_run_at_once_are_refused(here, monkeypatch):
    def second(*_, **__):
        with pytest.raises(InputError, match="another `learn fit` trains run"):
            fit(small_config("s.zarr"), here / "runs" / "new", resume=True)
        raise KeyboardInterrupt

    monkeypatch.setattr("learn.training.workers.train", second)
    with pytest.raises(KeyboardInterrupt):
        fit(small_config("s.zarr"), here / "runs" / "new")


# --- going on ------------------------------------------------------------------------------------


def unfinish(folder):
    """As after a kill: sway is not trained."""
    description = json.loads((folder / "run.json").read_text())
    write_sealed(folder / "run.json", {**description, "complete": False})
    for ending in (".json", ".safetensors"):
        (folder / f"sway-0{ending}").unlink()


def test_a_run_says_how_well_its_networks_were_trained(here):
    """The figures are those of its metrics."""
    run = open_run("done")
    lines = [json.loads(line) for line in (run.folder / METRICS).read_text().splitlines()]
    for name, said in read_description(run.folder)["networks"].items():
        its = [line for line in lines if line["network"] == name]
        assert said["validation_mse"] == min(line["validation_mse"] for line in its)
        last = {key: its[-1][key] for key in ("train_mse", "seconds")}
        assert {key: said[key] for key in last} == last
        assert (said["steps"], said["epochs"]) == (its[-1]["step"], its[-1]["epoch"])


def test_a_run_is_gone_on_with_by_its_name_alone(here, capsys):
    folder = here / "runs" / "done"
    weights = (folder / "sway-0.safetensors").read_bytes()
    unfinish(folder)
    code, _, err = call(capsys, "fit", "--name", "done", "--resume", "--workers", "1")
    assert code == 0, err
    assert (folder / "sway-0.safetensors").read_bytes() == weights
    assert open_run("done").features == ("sin_pitch", "depth_rate")


def test_options_that_differ_are_refused_and_only_they_are_named(here, capsys):
    unfinish(here / "runs" / "done")
    store = here / "s.zarr"
    words = ("fit", store, "--name", "done", "--resume", "--epochs", "1", "--layers", "1")
    code, _, err = call(capsys, *words, "--seed", "9", "--hidden", "5", "--without", "controls")
    assert code == 2
    assert "hidden 4 instead of 5; seed 0 instead of 9" in err
    assert "features" in err
    for same in ("store", "epochs", "layers", "members", "device"):
        assert f"{same} " not in err.partition("started with")[2].partition(": leave")[0]


def test_another_device_may_go_on(here):
    config = small_config("s.zarr")
    other = FitConfig.of({**to_json(config), "training": {"device": "auto"}}, here)
    changes = config.differences(other)
    assert not [change for change in changes if "device" in change]
    assert changes == ["seconds 0.0 instead of 120.0", "epochs 1 instead of 0"]


def test_a_store_that_changed_is_noticed(here, capsys):
    unfinish(here / "runs" / "done")
    write_synthetic_store(here / "other.zarr", [300, 280, 262], [0, 0, 1])
    shutil.rmtree(here / "s.zarr")
    (here / "other.zarr").rename(here / "s.zarr")
    code, _, err = call(capsys, "fit", "--name", "done", "--resume", "--workers", "1")
    assert code == 2
    assert "store s.zarr is not the one that run runs/done was started on" in err


def test_half_a_line_of_metrics_is_left_out_and_taken_out_by_the_next_fit(here):
    folder = here / "runs" / "done"
    path = folder / METRICS
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"network": "sw')
    run = Run(folder, read_description(folder))
    assert len(run.metrics()) == len(whole.splitlines())
    unfinish(folder)
    fit(small_config("s.zarr"), folder, resume=True)
    assert path.read_bytes().startswith(whole + b'{"network": "sway-0"')
    path.write_bytes(b"{\n" + whole)
    with pytest.raises(StoreError, match=rf"{METRICS} is damaged in line 1"):
        run.metrics()


CHILD = (
    "import sys, time; from learn.training.resources import end_with; end_with(int(sys.argv[1]));"
)
CHILD += "print(1); sys.stdout.flush(); time.sleep(3600)"
PARENT = """
import os, subprocess, sys
child = subprocess.Popen([sys.executable, "-c", sys.argv[1], str(os.getpid())],
                         stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
child.wait()
"""


def test_a_process_ends_with_its_parent():
    command = [sys.executable, "-c", PARENT, CHILD]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        assert alive(child)
        parent.kill()
    deadline = time.monotonic() + HANG_S
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not alive(child)


def alive(pid):
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


def test_what_a_kill_left_of_a_replacement_is_no_run(here):
    """It was being removed when its description was gone."""
    left = training_folder(here / "runs" / "done", replace=True)
    left.mkdir(parents=True)
    (left / "surge-0.safetensors").touch()
    run = fit(small_config("s.zarr"), here / "runs" / "done", replace=True, resume=True)
    assert run.networks()
    assert not left.parent.exists()


def test_a_store_with_a_sensor_that_is_not_here_is_refused_before_anything_is_trained(here, capsys):
    path = here / "s.zarr" / "zarr.json"
    metadata = json.loads(path.read_text())
    metadata["attributes"]["sensors"] = "field+turbidity"
    path.write_text(json.dumps(metadata))
    code, _, err = call(capsys, "fit", "s.zarr", "--name", "own", *QUICK)
    assert code == 2
    assert "unknown sensor 'turbidity'" in err
    assert "GLIDER_TWIN_PLUGINS" in err
    assert not (here / "runs" / "own").exists()


KILLED = """
import multiprocessing, time
from learn.training.resources import _Pool

def hold(path):
    lock = multiprocessing.get_context("spawn").Lock()
    open(path, "w").close()
    time.sleep(60)

if __name__ == "__main__":
    import pathlib, sys
    pool = _Pool(1)
    pool.submit(hold, sys.argv[1])
    while not pathlib.Path(sys.argv[1]).exists():
        time.sleep(0.01)
    pool.kill()
"""


def test_killed_workers_leave_nothing_to_read(tmp_path):
    program = tmp_path / "killed.py"
    program.write_text(KILLED)
    words = [sys.executable, str(program), str(tmp_path / "begun")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    assert done.stderr == ""


def test_the_command_is_kept_as_it_was_typed(here, capsys, monkeypatch):
    """As one line that a shell reads again, with every word of it."""
    kept = []

    def stop(*_, history, **__):
        kept.append(history)
        raise InputError("enough")

    monkeypatch.setattr("learn.training.fit", stop)
    words = ["fit", "my store.zarr", "--name", "mine", *QUICK]
    monkeypatch.setattr(sys, "argv", ["learn", *map(str, words)])
    (here / "s.zarr").rename(here / "my store.zarr")
    assert call(capsys, *words)[0] == 2
    assert [shlex.split(line) for line in kept] == [["learn", *map(str, words)]]
