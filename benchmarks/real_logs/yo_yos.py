"""Yo-yos: depth rates in a vehicle's logs, compared with its twin.

    factory import lrauv FOLDER --out shore.zarr
    python -m benchmarks.real_logs.yo_yos shore.zarr [--vehicle tethys] [--pitch 10 15 20]
        [--speed 1] [--json]

A leg is a descent or climb between two turns of the depth by more than 5 m; its rate is the
change of depth divided by the duration, inflections included. Legs with less than nine tenths of
their samples are left out. The twin flies a saw-tooth between the median turning depths of the
logs, at each pitch and at one speed through the water, in still water. For logs without attitude,
the pitch at which the twin has the logs' rates is interpolated.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from twin.errors import InputError
from twin.identify.replayed_dive import legs_of
from twin.records.logged import LogStore

Array = NDArray[np.float64]

KNOWN = 0.9
"""[1] Least fraction of a leg's samples near original ones"""
YOS = 3.0
"""Number of dives of the twin at each pitch; the first starts at the surface and is left out"""


@dataclasses.dataclass(frozen=True)
class Rates:
    """Depth rates [m/s] of legs, in size, and their turning depths."""

    down: Array
    up: Array
    top: float
    """[m] Median depth of the shallow ends"""
    bottom: float
    """[m] Median depth of the deep ends"""

    def row(self, name: str) -> dict[str, object]:
        """Row of a table or of JSON."""
        found: dict[str, object] = {"of": name}
        for way, values in (("down", self.down), ("up", self.up)):
            if not values.size:
                raise InputError(f"{name}: no leg goes {way}")
            low, middle, high = np.percentile(values, [25.0, 50.0, 75.0])
            found[f"{way} [m/s]"] = float(middle)
            found[f"{way}, quartiles"] = [float(low), float(high)]
            found[f"legs {way}"] = int(values.size)
        return found


def rates(dives: Sequence[tuple[Array, float]], skip: int = 0) -> Rates:
    """Rates of the legs of some dives.

    Args:
      dives: depth [m], NaN where unknown, and sample period [s] of each dive.
      skip: legs at the beginning of each dive that do not count.
    """
    down, up, tops, bottoms = [], [], [], []
    for depth, period in dives:
        there = np.isfinite(depth)
        if there.sum() < 2:
            continue
        index = np.arange(len(depth))
        for leg in legs_of(np.interp(index, index[there], depth[there]))[skip:]:
            if leg.last == leg.first or there[leg.samples].mean() < KNOWN:
                continue
            rate = (leg.bottom - leg.top) / (period * (leg.last - leg.first))
            (down if leg.phase == "dive" else up).append(rate)
            tops.append(leg.top)
            bottoms.append(leg.bottom)
    if not tops:
        raise InputError("no leg of a yo-yo: the depth never turns round by 5 m")
    return Rates(np.array(down), np.array(up), float(np.median(tops)), float(np.median(bottoms)))


def logged(store: Path) -> Rates:
    """Rates of all dives in a store of logs."""
    with LogStore(store) as logs:
        dives = []
        for mission in range(len(logs)):
            gap = logs.signal("measured_gap", mission) > 0.0
            depth = logs.signal("measured_depth", mission)
            dives.append((np.where(gap, np.nan, depth), logs.period))
    return rates(dives)


def flown(vehicle: str, pitch_deg: float, speed: float, top: float, bottom: float) -> Rates:
    """Rates of the vehicle's twin between two depths [m]; errors as `twin.simulate`."""
    import twin

    saw_tooth = twin.SawTooth(
        max_depth_m=bottom,
        min_depth_m=max(top, SHALLOWEST),
        pitch_deg=pitch_deg,
        speed_m_s=speed,
        yos=YOS,
    )
    mission = twin.Mission(name="yo-yos", segments=(saw_tooth,))
    found = twin.simulate(vehicle=vehicle, mission=mission)
    period = float(found.time[1] - found.time[0])
    return rates([(np.asarray(found["true_depth"], float), period)], skip=1)


SHALLOWEST = 2.0
"""[m] Least turning depth of the twin, also if the log turns at the surface"""


def matching_pitch(pitch: Sequence[float], have: Sequence[float], wanted: float) -> float:
    """Interpolate the pitch [degree] with a wanted rate [m/s]; NaN outside the flown pitches."""
    order = np.argsort(have)
    rate, angle = np.asarray(have)[order], np.asarray(pitch)[order]
    return float(np.interp(wanted, rate, angle, left=math.nan, right=math.nan))


def main(
    store: command.Positional[Path],
    *,
    vehicle: str = "tethys",
    pitch: tuple[float, ...] = (10.0, 15.0, 20.0),
    speed: float = 1.0,
    json: bool = False,
) -> None:
    """Print the rates of the logs and of the twin, and its pitch at the logs' rates.

    Args:
      speed: [m/s] speed through the water.
    """
    real = logged(store)
    twins = [flown(vehicle, one, speed, real.top, real.bottom) for one in pitch]
    rows = [real.row(store.name)]
    rows += [t.row(f"{vehicle}, {one:g} deg") for one, t in zip(pitch, twins, strict=True)]
    match = {
        way: matching_pitch(
            pitch, [float(np.median(getattr(one, way))) for one in twins],
            float(np.median(getattr(real, way))),
        )
        for way in ("down", "up")
    }  # fmt: skip
    command.say({"rows": rows, "matching_pitch_deg": match}, rows, [match], json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
