"""`learn velocities`: surge and sway of a store by the shipped networks, without torch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from learn.files import check_file
from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK


@dataclass(frozen=True, kw_only=True)
class Velocities(JsonOption):
    """Estimate surge and sway of missions or logs by the networks that this package ships.

    Missions with the truth judge the networks beside the methods without training: the method with
    the least track error is written.

    Example:

        learn velocities real.zarr --out velocities.csv
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """store of missions or logs"""
    out: Path | None = None
    """CSV file: mission, time in s, surge and sway in m/s"""
    split: str = "all"
    """missions: train, validation, test or all"""

    def run(self, console: Console) -> int:
        """Estimate, judge, write."""
        import numpy as np

        from learn.evaluation import NETWORK, best_method, evaluate
        from learn.networks import ShippedNetworks, write_velocities
        from twin.errors import InputError

        if self.out is not None:
            if self.out.suffix != ".csv":
                raise InputError(f"--out {self.out}: the file is a CSV; name it .csv")
            check_file(self.out, "--out")
        with ShippedNetworks(self.store) as shipped:
            best, errors = NETWORK, dict[str, float]()
            found: list[Any] = []

            def keep(reference: Any, estimates: Mapping[str, Any]) -> None:
                one, said = reference.mission, estimates[NETWORK]
                found.append(
                    (one.index, one.period * np.arange(one.samples), said.surge, said.sway)
                )

            if shipped.judged:
                judged = evaluate(shipped.networks, self.store, split=self.split, watch=keep)
                best, errors = best_method(judged.to_json())
                if best != NETWORK:
                    found = list(shipped.baseline(best, self.split))
            else:
                found = [(p.mission, p.time, p.surge, p.sway)
                         for p in shipped.predictions(self.split)]  # fmt: skip
            absent = shipped.absent
        rows = [
            {"mission": mission, "hours": time[-1] / 3600.0,
             "mean surge [m/s]": float(np.nanmean(surge)),
             "mean sway [m/s]": float(np.nanmean(sway))}
            for mission, time, surge, sway in found
        ]  # fmt: skip
        if self.out is not None:
            write_velocities(self.out, found)
        console.answer(method=best, track_error_percent=errors, replaced=absent, missions=rows)
        console.table(rows, title=f"velocities by {best}", digits=3)
        console.say()
        for sentence in _sentences(errors, best, absent):
            console.item(sentence)
        if self.out is not None:
            console.say(f"velocities: {self.out}")
        return EXIT_OK


def _sentences(errors: dict[str, float], best: str, absent: tuple[str, ...]) -> Iterator[str]:
    """Sentences on replaced channels, and on what wins."""
    if absent:
        yield f"replaced by values from attitude and depth: {', '.join(absent)}"
    if not errors:
        yield "no truth in the store: nothing judges these velocities"
        return
    listed = ", ".join(f"{n} {v:.2f}" for n, v in sorted(errors.items(), key=lambda kv: kv[1]))
    yield f"track error with true attitude, % of the path: {listed}"
    if best != "network":
        yield f"the networks do not win on this store: {best} does, and these are its velocities"
