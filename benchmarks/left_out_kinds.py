"""Left-out vehicle types: networks on a glider type unseen in training, against its own networks.

    python -m benchmarks.left_out_kinds [--folder WORK] [--hours 100] [--seconds 40] [--seed 0]
        [--json]

For each of four glider types, networks are trained on the three others, on that type alone, and on
all four. Test missions of the type have 40 % more drag, as in `benchmarks.dead_reckoning`, tier
`family`. Scores are after five dives, unadapted, and adapted to these dives as `learn adapt` does
without a velocity. The ratio is the error of the networks of other types, divided by the error of
the type's own networks, with a bootstrap over the missions.

Networks of several types do not read controls, whose units are each vehicle's own, but the flight
filter's estimates; those of one type have all inputs. Stores and runs stay in the folder: remove
it after a change of the code that flies or trains.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks import command
from benchmarks.dead_reckoning.rivals import Predicted, adapt_each, baseline, made_once
from benchmarks.dead_reckoning.scoring import interval, mission_errors
from benchmarks.dead_reckoning.tiers import DIVES, HEAVY, Tier
from twin.navigation.features import FLIGHT, INPUT_SETS
from twin.numbers import Array

LAST = DIVES[-1]
SLOWER = {**HEAVY, "mission.max_depth_m": "uniform(40, 120)"}
"""Changes for types that sink half as fast as the Sea-Wing: six hours hold more than five dives"""
KINDS = {"glider": HEAVY, "slocum-200": SLOWER, "seaglider": SLOWER, "seaexplorer": SLOWER}
"""Vehicles, with the changes of their test missions to preset `field`"""
SHARED = (*(group for group in INPUT_SETS["full"] if group != "controls"), FLIGHT)
"""Groups of inputs with the same meaning on every glider"""
ADAPTED = (0, LAST)
"""Numbers of dives adapted to that are printed"""


def recipes(hours: float) -> dict[str, Tier]:
    """Training and test store of each type."""
    return {
        kind: Tier(
            train={"preset": "family", "vehicle": kind, "hours": hours, "seed": 9031 + place,
                   "engine": "lanes"},
            test={"preset": "field", "vehicle": kind, "hours": 192.0, "seed": 9041 + place,
                  "engine": "lanes", "changes": changes},
            dives=LAST,
        )
        for place, (kind, changes) in enumerate(KINDS.items())
    }  # fmt: skip


def judged(
    folder: Path, hours: float, seconds: float, seed: int
) -> Iterator[tuple[str, str, dict[int, Array]]]:
    """Type, method, and error [%] of each test mission by number of dives adapted to."""
    stores = {
        kind: tier.make(folder / f"{kind}-{hours:g}h") for kind, tier in recipes(hours).items()
    }
    runs = folder / "runs"
    for kind, (own, test) in stores.items():
        others = [train for name, (train, _) in stores.items() if name != kind]
        taught = {
            "networks of the others": (f"others-than-{kind}", others),
            "networks of the kind": (kind, [own]),
            "networks of all four": ("all", [train for train, _ in stores.values()]),
        }
        said: dict[str, Predicted] = {
            "steady flight": baseline("steady_flight").predict(own, test, seed, seconds),
            "flight filter": baseline("flight_filter").predict(own, test, seed, seconds),
        }
        for method, (name, some) in taught.items():
            run = made_once(
                runs / f"{name}-{hours:g}h-{seed}-{seconds:g}s", some, seed=seed, seconds=seconds,
                features=SHARED if len(some) > 1 else (),
            )  # fmt: skip
            said[method] = adapt_each(run, test, "none")
        for method, predicted in said.items():
            yield kind, method, mission_errors(test, LAST, predicted)[0]


def figures(found: Mapping[str, Mapping[str, Mapping[int, Array]]]) -> dict[str, Any]:
    """Means with intervals by type and method, and the ratio of the type."""
    answer: dict[str, Any] = {}
    for kind, methods in found.items():
        answer[kind] = {
            "methods": {
                method: {
                    str(dives): {
                        "dr_velocity_percent": float(each[dives].mean()),
                        "interval": interval(each[dives]),
                        "missions": each[dives].size,
                    }
                    for dives in ADAPTED
                    if dives in each
                }
                for method, each in methods.items()
            }
        }
        far, near = (methods[f"networks of the {one}"][LAST] for one in ("others", "kind"))
        ratio = float(far.mean() / near.mean())
        answer[kind]["ratio"] = {"value": ratio, "interval": interval(far, near)}
    return answer


def rows(answer: Mapping[str, Any]) -> list[dict[str, object]]:
    """Table row of each type and method."""
    lines: list[dict[str, object]] = []
    for kind, one in answer.items():
        for method, by_dives in one["methods"].items():
            line: dict[str, object] = {"kind": kind, "method": method}
            for dives in ADAPTED:
                if shown := by_dives.get(str(dives)):
                    line[f"{dives} dives, %"] = _text(
                        shown["dr_velocity_percent"], shown["interval"]
                    )
            if method == "networks of the others":
                line["ratio"] = _text(one["ratio"]["value"], one["ratio"]["interval"])
            lines.append(line)
    return lines


def _text(value: float, spread: tuple[float, float]) -> str:
    return f"{value:.2f} ({spread[0]:.2f} to {spread[1]:.2f})"


def main(
    *,
    folder: Path = Path("data/left_out_kinds"),
    hours: float = 100.0,
    seconds: float = 40.0,
    seed: int = 0,
    json: bool = False,
) -> None:
    """Print the errors by type and method, and the ratios.

    Args:
      hours: length of each type's training store.
      seconds: training time of each network.
    """
    found: dict[str, dict[str, dict[int, Array]]] = {}
    for kind, method, each in judged(folder, hours, seconds, seed):
        found.setdefault(kind, {})[method] = each
    answer = figures(found)
    command.say(answer, rows(answer), json=json)
    if not json:
        counts = ", ".join(
            f"{kind} {one['methods']['flight filter']['0']['missions']}"
            for kind, one in answer.items()
        )
        print(f"missions: {counts}; scored behind {LAST} dives; true attitude")


if __name__ == "__main__":
    sys.exit(command.run(main))
