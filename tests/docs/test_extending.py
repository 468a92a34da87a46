"""Every type of one's own in examples/own_types, by the commands of docs/howto/extending.md."""

import json
import os
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from examples import OWN, ROOT, needs_docs

import learn
from factory.samples import Flight, write_csv
from twin.errors import InputError
from twin.plugins import PLUGINS
from twin.records.store import open_store

pytestmark = needs_docs

SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)

FLIGHT = Flight()

# One process runs every command, so that the vehicle with its own part and law is compiled once.
DRIVER = """
import importlib, json, runpy, sys

if __name__ == "__main__":
    for program, *words in json.load(open("commands.json")):
        if program == "python":
            runpy.run_path(*words)
            continue
        code = importlib.import_module(f"{program}.__main__").PROGRAM.main(words)
        if code:
            sys.exit(f"{program} {' '.join(words)}: exit code {code}")
"""


def page():
    return (ROOT / "docs" / "howto" / "extending.md").read_text(encoding="utf-8")


def files():
    """Text of each file with a type of one's own."""
    return {one.name: one.read_text("utf-8") for one in OWN.iterdir() if one.is_file()}


def commands():
    """Plugin files and words of each command of the page, in its order."""
    found = []
    for block in SHELL.findall(page()):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line)
            plugins = words.pop(0).partition("=")[2] if words[0].startswith(PLUGINS) else ""
            found.append((plugins, words))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the page's files, in which its commands have run."""
    folder = tmp_path_factory.mktemp("own")
    for name, text in files().items():
        (folder / name).write_text(text)
    _write_log(folder)
    plugins = {name for names, _ in commands() for name in names.split(os.pathsep) if name}
    (folder / "commands.json").write_text(json.dumps([words for _, words in commands()]))
    (folder / "driver.py").write_text(DRIVER)
    done = subprocess.run(
        [sys.executable, "driver.py"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), PLUGINS: os.pathsep.join(sorted(plugins))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (folder / "output.txt").write_text(done.stdout)
    return folder


def _write_log(folder):
    """A log with the columns that the importer of docs/howto/import_tables.md reads."""
    state = FLIGHT.state(FLIGHT.time)
    columns = {"time": FLIGHT.time, "my_depth": state["depth"], "my_pitch": state["pitch"]}
    write_csv(folder / "log.csv", columns)


def test_every_file_is_a_plugin_of_a_command():
    named = {name for names, _ in commands() for name in names.split(os.pathsep) if name}
    assert named == {name for name in files() if name.endswith(".py")} - {
        "own_vehicle.py",
        "braking.py",
        "cruise.py",  # tests/twin/control/test_own_task.py
        "two_thirds.py",  # tests/twin/logs/test_flight.py
    }
    assert [name for name in files() if f"`{name}`" not in page()] == []


def test_each_command_took_the_kind_of_its_file(folder):
    output = (folder / "output.txt").read_text()
    assert "all within the limits" in output  # of `twin check`: both codes of part and law agree
    assert "flew 'drifting'" in output
    assert "airbrake out to 1.00" in output
    assert "constant speed" in (folder / "runs" / "own" / "report" / "index.html").read_text()
    assert (folder / "histogram.png").stat().st_size > 0
    lines = (folder / "counts.csv").read_text().splitlines()
    assert len(lines) == open_store(folder / "turbid.zarr").sizes["mission"]


def test_what_they_wrote_holds_their_signals(folder):
    jet = open_store(folder / "jet.zarr")
    assert json.loads(jet.attrs["scenario"])["current"]["kind"] == "jet"
    assert float(jet["true_current_east"].max()) == pytest.approx(0.3, abs=0.01)
    turbid = open_store(folder / "turbid.zarr")  # flown by worker processes
    assert turbid["measured_turbidity"].attrs["units"] == "NTU"
    assert np.isfinite(turbid["measured_turbidity"].values[0, :100]).all()
    navigated = open_store(folder / "by_constant.zarr")
    assert json.loads(navigated.attrs["scenario"])["navigate"]["estimator"] == "constant_speed"
    assert open_store(folder / "mine.zarr").sizes["mission"] == FLIGHT.dives


def test_networks_of_plugin_files_train_in_worker_processes(folder):
    description = json.loads((folder / "runs" / "own" / "surge-0.json").read_text())
    assert description["network"]["kind"] == "leaky"
    with pytest.raises(InputError, match=r"name the file leaky\.py in GLIDER_TWIN_PLUGINS$"):
        learn.evaluate(folder / "runs" / "own", folder / "turbid.zarr")
