"""The benchmarks of `make bench` run as they are told to, and print their figures."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import numpy as np

from benchmarks import current_sampling, sensor_cost, suite_step, window_reading
from twin.sensors import SensorSuite

MAKEFILE = Path(__file__).parents[2] / "Makefile"


def numbers(line: str) -> list[float]:
    """The numbers after the name that a line begins with."""
    return [float(word) for word in re.findall(r"(?<= )[0-9.]+(?= |$)", line)]


def test_make_bench_names_programs_that_can_be_run():
    names = re.search(r"^BENCHMARKS := (.*)$", MAKEFILE.read_text(), re.M)
    assert names is not None
    programs = [importlib.import_module(f"benchmarks.{name}") for name in names[1].split()]
    assert len(programs) > 8
    for program in programs:
        assert f"python -m {program.__name__}" in (program.__doc__ or "")


def test_every_device_of_the_preset_has_a_cost(monkeypatch, capsys):
    monkeypatch.setattr(sensor_cost, "REPEATS", 1)
    sensor_cost.main()
    _, *rows = capsys.readouterr().out.partition("\n\n")[0].splitlines()
    assert [row.split()[0] for row in rows] == list(SensorSuite.preset("field"))
    assert all(numbers(row)[0] > 0.0 for row in rows)


def test_currents_and_tasks_have_a_cost(monkeypatch, capsys):
    monkeypatch.setattr(current_sampling, "REPEATS", 1)
    current_sampling.main()
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) > 8
    assert all(float(row.split()[-2]) > 0.0 for row in rows)
    monkeypatch.setattr(suite_step, "REPEATS", 1)
    monkeypatch.setattr(sys, "argv", ["suite_step"])
    suite_step.costs()
    _, *rows = capsys.readouterr().out.splitlines()
    assert {"hold", "depth"} <= {row.split()[0] for row in rows}
    assert all(np.all(np.array(numbers(row)) > 0.0) for row in rows)


def test_windows_are_read_in_every_way(monkeypatch, capsys):
    monkeypatch.setattr(window_reading, "ROUNDS", 1)
    monkeypatch.setattr(window_reading, "SLICES", 1)
    assert window_reading.main(hours=1.0, memory_mb=0.5) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == 6
