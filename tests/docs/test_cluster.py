"""The blocks of docs/howto/cluster.md run as they stand there: a changed page is a changed test.

What belongs to an installation is replaced by programs of the same name that stand in front of it:
`sbatch` runs the tasks of an array here, `pip` only notes what it was asked for.
"""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import xarray as xr
from patience import HANG_S
from s3 import s3_server
from trees import contents

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/howto/cluster.md").read_text(encoding="utf-8")
PROGRAMS = Path(__file__).with_name("programs")
LESSON = """
import sys
sys.path.insert(0, "scripts")
import tutorials
from pathlib import Path

if __name__ == "__main__":
    print(tutorials.Lesson(Path(sys.argv[1])).shell(sys.argv[2]))
"""
"""Commands of one block in one process, as the tutorials run them: each library is loaded once"""


def blocks(section, language="sh"):
    """The page's blocks below a heading."""
    text = PAGE.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    found = re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S)
    assert found, f"no block of {language} below {section}"
    return found


class Machine:
    """A folder with the programs in its path."""

    def __init__(self, folder):
        self.folder = folder
        self.groups: list[int] = []
        bin = folder / "bin"
        bin.mkdir()
        for name in ("factory", "learn", "twin", "dask"):
            self._program(bin / name, f'exec "{sys.executable}" -m {name} "$@"')
        self._program(bin / "pip", f'echo "$@" >> "{folder}/pip.log"')
        self._program(bin / "python", 'mkdir -p "$3/bin"; touch "$3/bin/activate"')
        for name in ("sbatch", "scancel"):
            self._program(bin / name, f'exec "{sys.executable}" "{PROGRAMS}/{name}.py" "$@"')
        self.environment = {
            **{n: t for n, t in os.environ.items() if not n.startswith(("SLURM_", "AWS_"))},
            "PATH": f"{bin}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "SLURM_STATE": str(folder / "slurm"),
        }

    def _program(self, path, line):
        path.write_text(f"#!/bin/sh\n{line}\n")
        path.chmod(0o755)

    def run(self, *words, code=0):
        """What a command says; it must end with this code."""
        # to a file: what a block leaves in the background would keep a pipe open
        log = self.folder / "said.txt"
        with log.open("w") as said:
            process = subprocess.Popen(
                words,
                cwd=self.folder,
                env=self.environment,
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            self.groups.append(process.pid)
            assert process.wait(HANG_S) == code, f"{words[-1]}\n{log.read_text()}"
        return log.read_text()

    def shell(self, block):
        """Run a block of the page."""
        return self.run("bash", "-ec", block)

    def together(self, block):
        """Run a block of our commands in one process."""
        (self.folder / "lesson.py").write_text(LESSON.replace("scripts", f"{ROOT}/scripts"))
        return self.run(sys.executable, "lesson.py", str(self.folder), block)

    def python(self, block):
        """Run a program of the page."""
        (self.folder / "program.py").write_text(block)
        return self.run(sys.executable, "program.py")


@pytest.fixture
def machine(tmp_path):
    one = Machine(tmp_path)
    yield one
    for group in one.groups:  # a scheduler and its workers go on in the background
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            continue


def test_what_pip_is_asked_for_is_there():
    """And every block of the page is run by one of the tests below."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [e for found in re.findall(r"glider-twin\[([^]]+)\]", PAGE) for e in found.split(",")]
    assert extras
    assert set(extras) <= set(project["optional-dependencies"])
    assert len(re.findall(r"^```\w+$", PAGE, re.M)) == 4 + 2 + 3 + 3 + 1


def test_slurm(machine):
    install, submit, look, again = blocks("Slurm")
    machine.shell(install)
    assert "glider-twin" in (machine.folder / "pip.log").read_text()
    machine.environment["SLURM_LOST"] = "1,3"  # their nodes fail once
    machine.shell(submit)
    assert not (machine.folder / "big.zarr").exists(), "afterok ran although tasks were lost"
    assert "missions" in machine.shell(look)
    told = machine.run("factory", "finish", "big.zarr", code=2)
    assert re.search(
        r"missions of big\.zarr are missing; .* of 4 again: --array=1,3$", told.strip()
    )
    machine.shell(again)
    machine.shell(again)  # complete: nothing is submitted
    wanted = re.search(r"^factory (generate .*) --out big\.zarr$", submit, re.M)
    assert wanted
    machine.run("factory", *wanted[1].split(), "--out", "one.zarr")
    assert contents(machine.folder / "big.zarr") == contents(machine.folder / "one.zarr")
    assert "SLURM_ARRAY_TASK_ID" in PAGE


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return str(found.getsockname()[1])


def test_a_dask_cluster(machine):
    pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')
    port = free_port()
    start, resume = (block.replace("8786", port) for block in blocks("Dask"))
    machine.shell(start)
    assert "already complete" in machine.shell(resume)
    machine.run("factory", "generate", "--hours", "2", "--out", "one.zarr")
    assert contents(machine.folder / "dask.zarr") == contents(machine.folder / "one.zarr")


def test_a_local_dask_cluster_in_python(machine):
    pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')
    assert "times real time" in machine.python(blocks("Dask", "python")[0])
    assert (machine.folder / "local.zarr/zarr.json").is_file()


def test_dask_jobqueue(machine):
    """Slurm's `sbatch` starts the workers that dask-jobqueue asks for."""
    pytest.importorskip("dask_jobqueue", reason="needs pip install dask-jobqueue")
    (machine.folder / "glider/bin").mkdir(parents=True)
    (machine.folder / "glider/bin/activate").touch()
    machine.python(blocks("Dask", "python")[1])
    assert (machine.folder / "queue.zarr/zarr.json").is_file()


def test_dask_kubernetes(machine):
    """A cluster of this machine stands for the one of Kubernetes."""
    pytest.importorskip("distributed", reason='needs pip install "glider-twin[cluster]"')
    shutil.copytree(PROGRAMS / "dask_kubernetes", machine.folder / "dask_kubernetes")
    with s3_server() as environment:
        machine.environment |= environment
        machine.python(blocks("Dask", "python")[2])
        assert "preset     field" in machine.run("factory", "info", "s3://bucket/kubernetes.zarr")


def test_s3(machine):
    install, one, parts = blocks("S3")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION", "AWS_ENDPOINT_URL"):
        assert f" {name}=" in install
    machine.shell(install)
    with s3_server() as environment:
        machine.environment |= environment
        said = machine.together(one)
        assert "of s3://bucket/missions.zarr" in said
        machine.shell(parts)
        machine.run("factory", "verify", "s3://bucket/missions.zarr")  # by a process of its own
    assert len(list((machine.folder / "og1").glob("*.nc"))) == 2
    assert (machine.folder / "runs/small/report/index.html").is_file()


def test_icechunk(tmp_path, monkeypatch):
    pytest.importorskip("icechunk", reason='needs pip install "glider-twin[icechunk]"')
    (program,) = blocks("Other zarr stores", "python")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(program, names)
    store = names["repository"].readonly_session("main").store
    assert xr.open_zarr(store, consolidated=False).attrs["seed"] == 0
