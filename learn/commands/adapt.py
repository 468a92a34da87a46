"""`learn adapt`: a run fitted to a vehicle by its first dives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK
from twin.cli.text_table import counted


@dataclass(frozen=True, kw_only=True)
class Adapt(JsonOption):
    """A run that knows one vehicle by its first dives: a new run, which `learn evaluate`, `learn
    export` and `--navigate network:RUN` take as any other.

    Fitted are drag, lift slope, drag due to lift, ballast, compressibility and the offsets of two
    accelerometers, which the flight filter then begins with and goes on from. Held-back dives
    decide whether anything is changed.

    Example:

        learn adapt demo first_dives.zarr --name calypso
    """

    run_folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """folder or name of the run"""
    store: Annotated[StoreArgument, tyro.conf.Positional, tyro.conf.arg(metavar="LOGS")]
    """store of the vehicle's dives, as `factory import` writes it"""
    name: str | None = None
    """of the new run [default: RUN-adapted]"""
    missions: tuple[int, ...] = ()
    """rows of the store, of this one vehicle [default: all]"""
    dives: int = 5
    """how many, from the first on"""
    labels: Literal["none", "dvl"] = "none"
    """velocities to learn from: none but the depth's, or those of a Doppler log in water lock"""
    overwrite: bool = False
    """replace a run of that name"""

    def run(self, console: Console) -> int:
        """Fit, say what was found, write the new run."""
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
