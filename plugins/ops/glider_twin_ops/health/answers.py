"""Answers: compass, drag, pump and energy of one deployment, each with its deviation.

    said = answer_for("real.zarr", "unit334", load_vehicle("mine.xml"))
    said.drag["value"], said.compass["iron_deg"], said.pump, said.energy

Drag and compass are beliefs (`beliefs`), the energy by device is `twin energy`'s, and
the pump is what its own strokes show.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.health.beliefs import FOLLOWED, Beliefs, follow_parameters
from glider_twin_ops.health.dive_channels import strokes_of
from twin import Vehicle, load_vehicle
from twin.errors import TwinError
from twin.identify import load_calibration, load_logs, start_vehicle
from twin.logs import energy_used
from twin.numbers import Array
from twin.records import LogStore
from twin.records.attributes import DIVE
from twin.records.storage import StorePath

COMPASS = ("heading_offset", "heading_cos", "heading_sin", "heading_cos2", "heading_sin2")
"""Beliefs that are a compass' deviation, as `Calibration.true_heading` adds them"""
TOLD = 0.7
"""Part of its spread that a belief's deviation must fall below for an answer"""
HEADINGS = np.arange(0.0, 360.0, 45.0)
"""[degree] at which a compass' deviation is said"""
DEPTHS = (0.0, 10.0, 30.0, 100.0, 200.0, 400.0, 700.0, 1000.0, 6000.0)
"""[m] between which a pump's strokes are counted together"""
LEAST_SAMPLES = 3
"""of pumping that a depth needs"""
SECONDS = 86400.0
"""[s] in a day"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Answers:
    """What a deployment says of its vehicle beside faults; None where the log does not tell."""

    beliefs: Beliefs | None
    dives: tuple[int, ...]
    """Numbers of the dives of the beliefs"""
    time: Array
    """[s] unix, of their begins, (dives,)"""
    compass: dict[str, Any] | None
    """Deviation, true less compass [degree], by heading, and the iron that makes its one cycle"""
    drag: dict[str, Any] | None
    """K_D0 [kg/m] over the dives, and its change from the first to the last, looking back"""
    pump: list[dict[str, float]] | None
    """By depth: rate [cm3/s] and power [W] with the deviations of their means"""
    energy: dict[str, Any] | None
    """Energy [kW h] and factor of each device"""
    lacking: dict[str, str]
    """Why the log does not tell: by answer"""

    def describe(self) -> dict[str, object]:
        """Plain values, as `--json` prints them."""
        kept = ("compass", "drag", "pump", "energy")
        return {name: getattr(self, name) for name in kept} | {"unanswered": self.lacking}


def answer_for(
    store: str | StorePath, deployment: str, vehicle: str | Path | Vehicle | None = None
) -> Answers:
    """Answer for one deployment of a store of logs.

    Args:
      vehicle: that made it, as `glider_twin_ops.health.assess` takes it.

    Raises:
      StoreError: no store of logs.
    """
    lacking: dict[str, str] = {}
    made = start_vehicle(store) if vehicle is None else vehicle
    flown = made if isinstance(made, Vehicle) else load_vehicle(made)

    def tried(name: str, answer: Callable[[], Any]) -> Any:
        try:
            return answer()
        except TwinError as error:
            lacking[name] = str(error)
            return None

    with LogStore(store) as logs:
        rows = logs.missions_of(deployment)
        pump = _pump(logs, rows)
        numbers = np.asarray(logs.array(DIVE) if DIVE in logs else np.arange(len(logs)), float)
        starts = np.asarray(logs.starts)
    if pump is None:
        lacking["pump"] = "the log has no strokes of a pump"
    beliefs = tried(
        "drag",
        lambda: follow_parameters(
            load_logs(store, rows, task="following a vehicle's drag"),
            load_calibration(flown),
            (*FOLLOWED, *COMPASS),
        ),
    )
    used = [] if beliefs is None else list(beliefs.rows)
    dives, time = tuple(int(number) for number in numbers[used]), starts[used]
    compass = None if beliefs is None else _compass(beliefs)
    if compass is None:
        lacking["compass"] = lacking.get("drag", "too few fixes of dives on different headings")
    return Answers(
        beliefs=beliefs,
        dives=dives,
        time=time,
        compass=compass,
        drag=None if beliefs is None else _drag(beliefs, dives, time),
        pump=pump,
        energy=tried("energy", lambda: _energy(store, rows, flown)),
        lacking=lacking,
    )


def _drag(beliefs: Beliefs, dives: Sequence[int], time: Array) -> dict[str, Any]:
    """Drag after each dive, and how much it changed over them all."""
    back, off = beliefs.value("drag", smoothed=True), beliefs.deviation("drag", smoothed=True)
    return {
        "unit": "kg m-1",
        "dives": list(dives),
        "days": ((time - time[0]) / SECONDS).tolist(),
        "value": beliefs.value("drag").tolist(),
        "deviation": beliefs.deviation("drag").tolist(),
        "change": float(back[-1] / back[0] - 1.0),
        "change_deviation": float(math.hypot(off[-1] / back[-1], off[0] / back[0])),
    }


def _compass(beliefs: Beliefs) -> dict[str, Any] | None:
    """Deviation by heading after the last dive; None where no heading's is told."""
    places = [[p.name for p in beliefs.parameters].index(name) for name in COMPASS]
    spread = np.array([beliefs.parameters[k].spread for k in places])
    value = np.array([beliefs.value(name)[-1] for name in COMPASS])
    covariance = beliefs.covariance[-1][np.ix_(places, places)] * np.outer(spread, spread)
    one_cycle = np.sqrt(np.diag(covariance))[1:3]
    if (one_cycle > TOLD * spread[1:3]).any():
        return None
    turn = np.deg2rad(HEADINGS)
    waves = (np.ones_like(turn), np.cos(turn), np.sin(turn), np.cos(2 * turn), np.sin(2 * turn))
    basis = np.stack(waves, axis=1)
    off = np.sqrt(np.einsum("hi,ij,hj->h", basis, covariance, basis))
    cosine, sine = value[1:3]
    iron = math.hypot(cosine, sine)
    along = np.array([cosine, sine]) / max(iron, 1e-12)
    return {
        "iron_deg": iron,
        "iron_deviation_deg": float(np.sqrt(along @ covariance[1:3, 1:3] @ along)),
        "largest_at_deg": math.degrees(math.atan2(sine, cosine)) % 360.0,
        "by_heading": [
            {"heading_deg": float(h), "deviation_deg": float(d), "standard_deviation_deg": float(s)}
            for h, d, s in zip(HEADINGS, basis @ value, off, strict=True)
        ],
    }


def _pump(logs: LogStore, rows: list[int]) -> list[dict[str, float]] | None:
    """Rate and power of what is pumped out, by depth."""
    signals = ("depth", "pump", "pump_power", "voltage", "battery_current")
    names = [f"measured_{name}" for name in signals]
    if any(name not in logs for name in names[:2]):
        return None
    blocks = {name: logs.rows(name, rows) for name in names if name in logs}
    depths, rates, powers = [], [], []
    for k, row in enumerate(rows):
        told = {name: block[k, : logs.samples[row]].astype(float) for name, block in blocks.items()}
        rate, _, pumping = strokes_of(told["measured_pump"], logs.period)
        power = told.get("measured_pump_power")
        if power is None and {"measured_voltage", "measured_battery_current"} <= told.keys():
            taken = told["measured_voltage"] * told["measured_battery_current"]
            power = taken - np.nanmedian(taken) if np.isfinite(taken).any() else None
        depths.append(told["measured_depth"][pumping])
        rates.append(rate[pumping])
        powers.append(np.full(int(pumping.sum()), math.nan) if power is None else power[pumping])
    depth, rate, power = (np.concatenate(parts) for parts in (depths, rates, powers))
    found = []
    for above, below in itertools.pairwise(DEPTHS):
        inside = (depth >= above) & (depth < below) & np.isfinite(rate)
        if inside.sum() < LEAST_SAMPLES:
            continue
        one = {"from_m": above, "to_m": below, "samples": int(inside.sum())}
        for name, values in (("rate_cm3_s", rate[inside]), ("power_w", power[inside])):
            values = values[np.isfinite(values)]
            if len(values) >= LEAST_SAMPLES:
                one[name] = float(np.mean(values))
                one[f"{name}_deviation"] = float(np.std(values, ddof=1) / math.sqrt(len(values)))
        found.append(one)
    return found or None


def _energy(store: str | StorePath, rows: list[int], vehicle: Vehicle) -> dict[str, Any]:
    """`twin energy` of the dives."""
    used = energy_used(store, vehicle, missions=rows)
    return {
        "power_w": used.power,
        "devices": {
            one.name: {
                "energy_kwh": one.energy / 3.6e6,
                "value": one.value,
                "deviation": one.deviation if math.isfinite(one.deviation) else None,
                "unit": one.unit,
            }
            for one in used.terms
        },
    }
