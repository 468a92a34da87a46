"""`learn export`: ONNX step models for on-board use."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from learn.runs.run import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.program import EXIT_OK
from twin.extras import require

WIDTH = 100
"""Columns of the answer's text."""


@dataclass(frozen=True, kw_only=True)
class Export(JsonOption):
    """One ONNX model per network: one time step with explicit state, checked over a mission."""

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""
    store: Path | None = None
    """store of the mission for the check [default: the run's own]"""
    out: Path | None = None
    """folder for the models [default: onnx/ in the run]"""

    def run(self, console: Console) -> int:
        """Export, check, say where."""
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        require("onnx", extra="onnx", purpose="learn export")
        require("onnxruntime", extra="onnx", purpose="learn export")
        from learn.data.dataset import load_missions
        from learn.data.features import channels_of
        from learn.networks.onnx_export import TOLERANCE, export_step

        run = newest_run() if self.run_folder is None else open_run(self.run_folder)
        folder = self.out or run.path / "onnx"
        networks = run.networks()
        channels = [
            c for ensemble in networks.values() for c in channels_of(ensemble.members[0].features)
        ]
        missions = load_missions(self.store or run.store, channels, split="all")
        longest = max(missions, key=lambda mission: mission.samples)
        checked = {
            f"{target}-{k}": export_step(member, folder / f"{target}-{k}.onnx", longest)
            for target, ensemble in networks.items()
            for k, member in enumerate(ensemble.members)
        }
        console.answer(run=run.path, tolerance=TOLERANCE, models=checked)
        console.table(
            [
                {
                    "model": str(parity.path),
                    "largest difference [m/s]": parity.largest,
                    "time per step [us]": parity.step_us,
                }
                for parity in checked.values()
            ],
            title=f"checked over the {longest.samples} samples of mission {longest.index}: at most "
            f"{TOLERANCE:g} m/s from the trained network",
            digits=3,
        )
        console.say()
        console.say(_features_line(run.features))
        return EXIT_OK


def _features_line(features: Sequence[str]) -> str:
    """The inputs in their order, in lines of a terminal."""
    text = f"features of each model, in this order: {', '.join(features)}"
    return textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
