"""`twin identify` as a user meets it: its help, its progress, and its picture."""

import io
import re

import numpy as np
import pytest
import xarray as xr

from twin.__main__ import PROGRAM
from twin.cli.console import Progress
from twin.records.attributes import CONVENTIONS, READER_VERSION
from twin.records.store import write_store
from twin.version import IMPORT_VERSION


def test_the_help_says_what_no_fixes_does(capsys):
    assert PROGRAM.main(["identify", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--no-fixes fit the depth rate only" in said
    assert "ten hours of log" in said


@pytest.mark.parametrize(("vehicle", "warned"), [("seaglider", True), ("slocum-200", False)])
def test_a_vehicle_of_another_kind_than_the_log_s_is_warned_of(vehicle, warned, tmp_path, capsys):
    data = xr.Dataset(
        {"n_samples": ("mission", [3])},
        {"time": [0.0, 0.5, 1.0]},
        {**CONVENTIONS, "source_format": "slocum", READER_VERSION: IMPORT_VERSION},
    )
    path = write_store(data, tmp_path / "real.zarr")
    assert PROGRAM.main(["identify", str(path), "--vehicle", vehicle]) == 2
    said = capsys.readouterr().err
    assert ("warning: vehicle seaglider (seaglider) is of another kind" in said) == warned


def test_a_share_is_percent_and_time_left_and_an_interrupted_task_has_no_last_line():
    clock, stream = iter(np.arange(0.0, 1000.0, 15.0)).__next__, io.StringIO()
    progress = Progress(
        total=1.0, label="identify", unit="", stream=stream, interval_s=30.0, clock=clock
    )
    with progress:
        for _ in range(6):
            progress.update(0.1)
        before = stream.getvalue()
        stop = KeyboardInterrupt()
        progress.__exit__(type(stop), stop, None)
        assert stream.getvalue() == before
    lines = before.splitlines()
    assert len(lines) >= 2
    for line in lines:
        assert re.fullmatch(r"identify: [^/]*%[^/]* left", line)
        assert " of " not in line
