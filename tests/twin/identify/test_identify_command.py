"""`twin identify` as a user meets it: its help, its progress, and its picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from twin.__main__ import PROGRAM
from twin.cli.console import Progress
from twin.records.attributes import CONVENTIONS, READER_VERSION
from twin.records.store import write_store
from twin.version import IMPORT_VERSION


def test_the_help_says_what_no_fixes_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert PROGRAM.main(["identify", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--no-fixes fit the depth rate only" in said
    assert "ten hours of log" in said


@pytest.mark.parametrize(("vehicle", "warned"), [("seaglider", True), ("slocum-200", False)])
def test_a_vehicle_of_another_kind_than_the_log_s_is_warned_of(
    vehicle: str, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = xr.Dataset(
        {"n_samples": ("mission", [3])},
        {"time": [0.0, 0.5, 1.0]},
        {**CONVENTIONS, "source_format": "slocum", READER_VERSION: IMPORT_VERSION},
    )
    path = write_store(data, tmp_path / "real.zarr")
    assert PROGRAM.main(["identify", str(path), "--vehicle", vehicle]) == 2
    said = capsys.readouterr().err
    assert ("warning: vehicle seaglider (seaglider) is of another kind" in said) == warned


def test_a_share_is_shown_as_percent_and_time_left() -> None:
    clock = iter(np.arange(0.0, 1000.0, 15.0)).__next__
    stream = io.StringIO()
    with Progress(
        total=1.0, label="identify", unit="", stream=stream, interval_s=30.0, clock=clock
    ) as progress:
        for _ in range(8):
            progress.update(0.1)
    lines = stream.getvalue().splitlines()
    assert len(lines) >= 2
    for line in lines:
        assert line.startswith("identify: ")
        assert "%" in line
        assert line.endswith("left")
        assert "/s" not in line
        assert " of " not in line


def test_an_interrupted_task_has_no_last_line() -> None:
    clock = iter(np.arange(0.0, 1000.0, 40.0)).__next__
    stream = io.StringIO()
    progress = Progress(
        total=1.0, label="fit", unit="", stream=stream, interval_s=30.0, clock=clock
    )
    with progress:
        progress.update(0.5)
        before = stream.getvalue()
        stop = KeyboardInterrupt()
        progress.__exit__(type(stop), stop, None)
        assert before
        assert stream.getvalue() == before
