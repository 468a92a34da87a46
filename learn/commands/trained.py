"""Commands on a trained run: `learn report`, `adapt`, `compare` and `export`."""

from __future__ import annotations

import shlex
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from learn import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK
from twin.cli.text_table import counted
from twin.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Compare(JsonOption):
    """Compare runs: their evaluations from `learn fit`, or new ones on one store.

    Example:

        learn compare demo field --store data/missions.zarr
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN ...")] = ()
    """folders or names of runs [default: the newest in runs/]"""
    store: Path | None = None
    """evaluate all runs on this store instead of reading their own evaluations"""
    split: str = "test"
    """missions of --store to evaluate: test, train, validation or all"""

    def run(self, console: Console) -> int:
        """Print one table."""
        from learn.report import comparison_rows

        figures = {}
        for run in [open_run(path) for path in self.runs] or [newest_run()]:
            if self.store is not None:
                from learn import evaluate

                found = dict(evaluate(run, self.store, split=self.split).figures)
            else:
                found = run.figures or {}
                if not found:
                    raise InputError(f"run {run.folder} was not evaluated; give --store STORE")
            figures[run.name if run.name not in figures else str(run.folder)] = found
        console.answer(runs=figures)
        stores = {(f["store"], f["split"]) for f in figures.values()}
        if len(stores) > 1:
            console.warn(
                "these runs were judged on different missions: "
                + "; ".join(f"{name}: {f['store']} ({f['split']})" for name, f in figures.items())
                + ". Give --store to judge them on the same ones"
            )
        store, split = sorted(stores)[0]
        where = f"{store} ({split})" if len(stores) == 1 else "each on its own store"
        console.table(comparison_rows(figures), title=f"missions: {where}", digits=3)
        return EXIT_OK


@dataclass(frozen=True, kw_only=True)
class Adapt(JsonOption):
    """Adapt a run to one vehicle from its first dives, as a new run for `learn evaluate`, `learn
    export` and `--navigate network:RUN`.

    The fit finds drag, lift slope, drag due to lift, ballast, compressibility and the offsets of
    two accelerometers. A flight filter then starts from them, if they predict held-back dives
    better than the vehicle file does.

    Example:

        learn adapt demo first_dives.zarr --name calypso
    """

    run_folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """folder or name of the run"""
    store: Annotated[StoreArgument, tyro.conf.Positional, tyro.conf.arg(metavar="LOGS")]
    """store of the vehicle's dives, as `factory import` writes it"""
    name: str | None = None
    """name of the new run [default: RUN-adapted]"""
    missions: tuple[int, ...] = ()
    """rows of the store, all of this one vehicle [default: all]"""
    dives: int = 5
    """number of dives to fit, from the first on"""
    labels: Literal["none", "dvl"] = "none"
    """velocities to fit: none, for the depth's rate alone, or a Doppler log's water track too"""
    overwrite: bool = False
    """replace a run with the new run's name"""

    def run(self, console: Console) -> int:
        """Fit, write the new run, print the result."""
        from learn import adapt, open_run
        from learn.run import RUNS, checked_name

        origin = open_run(self.run_folder)
        folder = RUNS / checked_name(self.name or f"{origin.name}-adapted")
        run, fit = adapt(
            origin,
            self.store,
            folder,
            missions=self.missions,
            dives=self.dives,
            labels=self.labels,
            overwrite=self.overwrite,
        )
        console.answer(run=run.folder, changed=fit.start is not None, adaptation=fit)
        console.table(
            fit.rows(),
            title=f"by {counted(fit.glides, 'steady glide')}"
            f"{' and the Doppler log' if fit.log else ''}",
            digits=2,
        )
        console.say()
        console.item(
            f"the hull that was found leaves of held-back glides {100.0 * fit.left_over:.0f} % of "
            "the squared residual that the file's leaves"
            + ("" if fit.start else ": the file's is the better one, and nothing is changed")
        )
        console.say(f"run: {run.folder}")
        return EXIT_OK


WIDTH = 100
"""Columns of the answer's text."""


@dataclass(frozen=True, kw_only=True)
class ExportNetwork(JsonOption):
    """Export one ONNX model per network, or one C99 header from sensor samples to surge and sway,
    and compare each file with the networks over a mission.

    Example:

        learn export demo --to c
    """

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""
    to: Literal["onnx", "c"] = "onnx"
    """onnx: networks without their inputs' computation; c: both"""
    store: Path | None = None
    """store of the mission for the check [default: the run's own]"""
    out: Path | None = None
    """folder for the models [default: onnx/ or c/ in the run]"""

    def run(self, console: Console) -> int:
        """Export, check, print the paths."""
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


@dataclass(frozen=True, kw_only=True)
class Report(JsonOption):
    """Evaluate the networks of a trained run on its store and write its page, as `learn fit` does.

    Example:

        learn report demo
    """

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""

    def run(self, console: Console) -> int:
        """Evaluate and write the report."""
        from learn.finishing import finish
        from learn.report import tell_report

        run = newest_run() if self.run_folder is None else open_run(self.run_folder)
        tell_report(
            console, finish(run, history=shlex.join(["learn", *sys.argv[1:]]), say=console.note)
        )
        return EXIT_OK
