"""`learn export`: ONNX step models or C99 for on-board use."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from learn import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.program import EXIT_OK

WIDTH = 100
"""Columns of the answer's text."""


@dataclass(frozen=True, kw_only=True)
class ExportNetwork(JsonOption):
    """One ONNX model per network, one time step with explicit state; or one C99 header from sensor
    samples to surge and sway. Checked over a mission.

    Example:

        learn export demo --to c
    """

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""
    to: Literal["onnx", "c"] = "onnx"
    """onnx: networks alone; c: networks and the features that they see"""
    store: Path | None = None
    """store of the mission for the check [default: the run's own]"""
    out: Path | None = None
    """folder for the models [default: onnx/ or c/ in the run]"""

    def run(self, console: Console) -> int:
        """Export, check, say where."""
        from learn import export

        folder = self.run_folder or newest_run().folder
        checked = export(folder, self.out, to=self.to, store=self.store)
        from learn.networks import TOLERANCE
        from twin.records import MissionStore

        most = f"{TOLERANCE * 1e3:g} mm/s"
        if self.to == "c":
            most += " in the root mean square or at one sample in 1000"
        run = open_run(folder)
        first = next(iter(checked.values()))
        with MissionStore(run.store if self.store is None else self.store) as reader:
            if odd := run.strange(reader.vehicle):
                console.warn(odd)
        console.answer(run=run.folder, tolerance=TOLERANCE, models=checked)
        console.table(
            [
                {
                    "model": str(parity.path),
                    "largest difference [mm/s]": 1e3 * parity.largest,
                    "root mean square [mm/s]": 1e3 * parity.rms,
                    "time per step [us]": parity.step_us,
                }
                for parity in checked.values()
            ],
            title="values of the exported model beside those of the trained network, over the "
            f"{first.samples} samples of mission {first.mission}; a difference above "
            f"{most} would have been refused",
            digits=3,
        )
        console.say()
        if self.to == "c":
            from twin.navigation import sources
            from twin.navigation.features import channels_of

            text = f"a sample holds: {', '.join(sources(channels_of(run.features)))}"
        else:
            text = f"features of each model, in this order: {', '.join(run.features)}"
        console.say(textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False))
        return EXIT_OK
