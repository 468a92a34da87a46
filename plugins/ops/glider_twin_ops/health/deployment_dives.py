"""Deployment's dives: read from a store of logs, with the settings that the pilot changed.

Echoes of the sea floor are compared with those that earlier dives had at the same heights above
it. The part of a dive in which an altimeter hears the floor depends on the depths of dive and floor
and on the beam's direction. Its beam is vertical while the vehicle dives. Pings with the nose up,
after the turn and still sinking, look aft and are left out.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from glider_twin_ops.forecast.logged_leg import legs_of
from glider_twin_ops.health.channels import CHANNELS, NAMES, PLACE, new_legs
from glider_twin_ops.health.dive_channels import (
    DiveSignals,
    channels_of,
    flight_model,
    imbalance,
)
from glider_twin_ops.health.signatures import TypicalDive, usual_dive
from twin import Vehicle
from twin.identify import Calibration
from twin.numbers import Array
from twin.records import LogStore, log_rows
from twin.records.attributes import DIVE, DIVE_DURATION
from twin.records.storage import StorePath

BIN, BINS = 5.0, 60
"""BIN: [m] height of the bins in which pings are counted. BINS: number of bins"""
LEAST, SOUND = 10.0, 0.5
"""LEAST: minimum number of expected echoes for a value. SOUND: smallest fraction received in a dive
that updates the counts; a blind altimeter must not lower the expectation."""


@dataclasses.dataclass(eq=False)
class Echoes:
    """Counts of the pings and echoes of all dives so far, by height above the floor."""

    floor: float = math.nan
    """[m] Depth of the floor where it was heard last"""
    pings: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))
    heard: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))

    def part(self, depth: Array, altitude: Array, pitch: Array | None = None) -> float:
        """Add a dive: its echoes over those expected [1]; NaN where fewer than `LEAST` are.

        Args:
          depth, altitude: [m], (n,); altitude NaN where no echo came back.
          pitch: [degree], nose up positive, (n,); None: not known.
        """
        down = np.isfinite(depth) & (np.diff(depth, prepend=math.nan) > 0.0)
        if pitch is not None:
            down &= ~(pitch > 0.0)
        deep, back = depth[down], np.isfinite(altitude[down])
        found = math.nan
        if back.sum() >= LEAST:
            found = float(np.median((deep + altitude[down])[back]))
        if found > self.floor + BIN:
            self.floor = found  # the floor is deeper than before: expect echoes from there
        elif deep.size and deep.max() > self.floor + BIN:
            self.floor = math.nan  # the dive went below the depth at which the floor was heard
        part = math.nan
        if math.isfinite(self.floor):
            at = self._bins(deep)
            expected = float((self.heard / np.maximum(self.pings, 1.0))[at].sum())
            if expected >= LEAST:
                part = float((back & (self.pings[at] > 0.0)).sum()) / expected
        if math.isfinite(found) and not part < SOUND:
            self.floor = found
            at = self._bins(deep)
            self.pings += np.bincount(at, minlength=BINS)
            self.heard += np.bincount(at, back, BINS)
        return part

    def _bins(self, depth: Array) -> NDArray[np.int64]:
        return np.clip((self.floor - depth) / BIN, 0, BINS - 1).astype(np.int64)


SETTINGS = {"depth": 0.2, "dive_pitch": 3.0, "dive_volume": 25.0, "climb_pitch": 3.0,
            "climb_volume": 25.0}  # fmt: skip
"""Settings of a dive and the change of each above which the pilot changed it: of the depth's
logarithm, [degree], [cm3]. Of preset `faulty`, without a pilot, 90 % of dives stay below"""
SHALLOW, SHALLOWER = 15.0, 0.2
"""A dive above SHALLOW [m] is a test; so are first dives above SHALLOWER of the median depth."""
UNKNOWN_MASS, LEAST_NET = 0.03, 0.02
"""[kg] UNKNOWN_MASS: standard deviation of a net mass by ballast and trim. LEAST_NET: smallest net
mass that counts"""
WATER_CHANGE, STRATIFIED = 0.05, 1.0
"""Without a logged density. WATER_CHANGE: [kg/m3] standard deviation of the water's mean density
from dive to dive. STRATIFIED: [kg/m3] change of density per logarithm of the dive's depth"""
UNTOLD_WARMING = 0.0015
"""Relative change of the hull's air from dive to dive where the log has no temperature: 0.4 K, the
RMS change of a dive's mean temperature in 81 pairs of dives of seven real deployments"""
LEG_POWER = 0.3
"""[W] Step of the power by the charge alone, which has the steering's work, where a leg begins: per
square root of 1 - cos(turn). 163 new legs of sound deployments have steps of 0.21 W RMS"""
FIRST, HEAVIER, WEIGHED = 5, 0.008, 0.02
"""FIRST: dives from which the weight is found. HEAVIER: largest relative change of the density in
which the vehicle is neutral, 0.4 kg of 54. WEIGHED: [kg/m3] its precision, 1 g of 54 kg"""
ROUND = 10.0
"""[m] Depth step to which the typical dive is rounded, so that deployments share its signatures"""
READ = (
    "depth", "pressure", "pitch", "roll", "heading", "pump", "shift", "rotation", "fin", "density",
    "temperature", "conductivity", "salinity", "altitude", "charge", "voltage", "battery_current",
    "pump_power", "vacuum", "dvl_mode", "gap", "depth_time",
)  # fmt: skip
"""Signals that channels are computed from, without `measured_`"""


def dives_of(
    logs: LogStore, deployment: str, calibration: Calibration | None = None
) -> tuple[list[int], list[DiveSignals], Array]:
    """Read the dives of a deployment in order of time.

    Args:
      calibration: compass deviation that the vehicle's file has.

    Returns:
      Rows of the store; the signals of each; its mean velocity through the water by the compass,
      north and east [m/s], (dives, 2), NaN where unknown.
    """
    rows = logs.missions_of(deployment)
    names = [*(f"measured_{one}" for one in READ), "commanded_heading"]
    blocks = {name: logs.rows(name, rows) for name in names if name in logs}
    blocks = {name: block for name, block in blocks.items() if np.isfinite(block).any()}
    deepest = np.array([np.nanmax(one, initial=0.0) for one in blocks.get("measured_depth", [])])
    # a pilot tests the vehicle before anything else; later shallow dives are ordered
    tests = np.cumprod(deepest < SHALLOWER * np.median(deepest)) if len(deepest) else deepest
    legs = {leg.mission: leg for leg in legs_of(logs, deployment)}
    dives, ways = [], np.full((len(rows), 2), math.nan)
    of_rows, echoes = log_rows(logs), Echoes()
    for k, row in enumerate(rows):
        count, powered = int(logs.samples[row]), of_rows[row].powered
        signals = {name: block[k, :count].astype(float) for name, block in blocks.items()}
        heading, current = signals.get("measured_heading"), (math.nan, math.nan)
        # a commanded heading, or a speed without the thruster's, gives no current
        if row in legs and not powered and heading is not None and np.isfinite(heading).any():
            leg = legs[row].leg
            ways[k] = turned(np.array(leg.through_water) / leg.duration, calibration)
            moved = np.array(leg.over_ground) / leg.duration - ways[k]
            current = (float(moved[0]), float(moved[1]))
        part, pitch = math.nan, signals.get("measured_pitch")
        if {"measured_depth", "measured_altitude"} <= signals.keys():
            part = echoes.part(signals["measured_depth"], signals["measured_altitude"], pitch)
        told: dict[str, Any] = {"current": current, "echoes": part, "powered": powered}
        told["way"] = (float(ways[k, 0]), float(ways[k, 1]))
        told["test"] = bool(len(tests)) and bool(tests[k] > 0 or deepest[k] < SHALLOW)
        dives.append(DiveSignals(period=logs.period, signals=signals, **told))
    return rows, dives, ways


def turned(way: Array, calibration: Calibration | None) -> Array:
    """Velocity, north and east, by the compass with the deviation that its vehicle's file has."""
    if calibration is None:
        return way
    heading = np.arctan2(way[1], way[0])
    off = float(calibration.true_heading(np.array([heading]))[0]) - heading
    return np.array([[math.cos(off), -math.sin(off)], [math.sin(off), math.cos(off)]]) @ way


def told_by(logs: LogStore, deployment: str, vehicle: Vehicle) -> dict[str, Any]:
    """Arguments of `judged` read from a deployment's log."""
    calibration, ballast = flight_model(vehicle), 0.0
    rows, dives, ways = dives_of(logs, deployment, calibration)
    if calibration is not None:
        calibration = ballasted(dives, calibration)
        density = calibration.vehicle.reference_density
        ballast = vehicle.mass * (1.0 - vehicle.reference_density / density)
    numbers = logs.array(DIVE) if DIVE in logs else np.arange(len(logs))
    lasted = np.nan_to_num(logs.number(DIVE_DURATION)[rows])
    changes = changes_of(dives)
    wander = np.zeros((len(dives), len(NAMES)))
    if all(dive.get("temperature") is None for dive in dives):
        wander[:, PLACE["air"]] = UNTOLD_WARMING
    if all(dive.get("battery_current") is None for dive in dives):
        wander[:, PLACE["hotel"]] = LEG_POWER * np.sqrt(new_legs(ways))
    blind = all(dive.get("density") is None for dive in dives)
    depths = changes[:, 0] if blind else None
    for name, steps in rate_steps(dives, vehicle, depths, ballast).items():
        wander[:, PLACE[name]] = steps
    return {
        "name": deployment,
        "numbers": tuple(int(numbers[row]) for row in rows),
        "values": values_of(dives, calibration),
        "time": np.asarray(logs.starts)[rows] + 0.5 * lasted,
        "ways": ways,
        "dive": typical(dives, vehicle),
        "changes": changes,
        "powered": [dive.powered for dive in dives],
        "tests": [dive.test for dive in dives],
        "wander": wander,
        "ballast": ballast,
    }


def values_of(dives: Sequence[DiveSignals], calibration: Calibration | None) -> Array:
    """Channels of dives, (dives, channels), as they are judged.

    Internal waves between a dive and its climb look like a slow thermistor. Where the log has
    conductivity, the lag between the two sensors replaces the thermistor's own.
    """
    found = np.array([channels_of(dive, calibration) for dive in dives]).reshape(-1, len(NAMES))
    for channel in CHANNELS:
        if channel.instead:
            found[np.isfinite(found[:, PLACE[channel.instead]]), PLACE[channel.name]] = math.nan
    return found


def ballasted(dives: Sequence[DiveSignals], calibration: Calibration) -> Calibration:
    """Calibration whose weight makes the first dives and climbs differ alike from its model.

    A weight that the file lacks moves the rates the more the less is pumped. With it in the model,
    the rates do not step where a pilot changes the volume, and a fault moves them as in the flights
    of the twin. It is one number for all dives, and hides no fault that begins among them.
    """
    whole = (dive for dive in dives if math.isfinite(imbalance(dive, calibration)))
    first = list(itertools.islice(whole, FIRST))
    own = calibration.vehicle.reference_density

    def off(density: float) -> float:
        trial = calibration.with_vehicle(reference_density=density)
        return float(np.nanmean([imbalance(dive, trial) for dive in first]))

    ends = own * (1.0 - HEAVIER), own * (1.0 + HEAVIER)
    if not first or not off(ends[0]) > 0.0 > off(ends[1]):
        return calibration
    return calibration.with_vehicle(reference_density=brentq(off, *ends, xtol=WEIGHED))


def changes_of(dives: Sequence[DiveSignals]) -> Array:
    """Change of each setting since the last dive that is no test, over `SETTINGS`, (dives, 5)."""
    rows = np.array([dive.settings() for dive in dives]).reshape(-1, len(SETTINGS))
    rows[:, 0] = np.log(np.maximum(rows[:, 0], 1.0))
    rows /= list(SETTINGS.values())
    found, before = np.zeros(rows.shape), np.full(len(SETTINGS), math.nan)
    for dive, row, change in zip(dives, rows, found, strict=True):
        change[:] = np.nan_to_num(row - before)
        if not dive.masked:
            before = np.where(np.isfinite(row), row, before)
    return found


def rate_steps(
    dives: Sequence[DiveSignals], vehicle: Vehicle, blind: Array | None, ballast: float = 0.0
) -> dict[str, Array]:
    """Steps of the rates from dive to dive by what is unknown of the net mass, (dives,) each.

    A rate goes with the square root of the net mass m: an unknown mass moves it by half of that
    over m, which is the more the less a pilot pumps.

    Args:
      blind: change of the depth's logarithm, over that of `SETTINGS`, where no dive has a density.
      ballast: [kg] weight that the vehicle's file lacks.
    """
    rows = np.array([dive.settings() for dive in dives]).reshape(-1, len(SETTINGS))
    if vehicle.steered("buoyancy") is None or not len(rows):
        return {}
    found = {}
    for name, volume in (("rate_dive", rows[:, 2]), ("rate_climb", rows[:, 4])):
        pulls = [vehicle.net_mass_for_pump(v) + ballast for v in np.nan_to_num(volume)]
        net = np.abs(pulls)
        over = np.where(np.isfinite(volume), 0.5 / np.maximum(net, LEAST_NET), 0.0)
        found[name] = UNKNOWN_MASS * np.abs(np.diff(over, prepend=over[:1]))
        if blind is not None:
            density = np.hypot(WATER_CHANGE, STRATIFIED * SETTINGS["depth"] * blind)
            found[name] = np.hypot(found[name], vehicle.mass / 1025.0 * density * over)
    return found


def typical_dive(store: str | StorePath, deployment: str, vehicle: Vehicle) -> TypicalDive:
    """Usual dive of a deployment's log; see `typical`."""
    with LogStore(store) as logs:
        return typical(dives_of(logs, deployment)[1], vehicle)


def typical(dives: Sequence[DiveSignals], vehicle: Vehicle) -> TypicalDive:
    """Usual dive of a log, rounded; settings that the log lacks are the vehicle file's."""
    rows = np.array([one.settings() for one in dives if not one.masked]).reshape(-1, 5)
    deepest = rows[np.isfinite(rows[:, 0]), 0]
    depth = float(np.median(deepest)) if len(deepest) else 150.0
    period = dives[0].period if dives else 4.0
    usual = usual_dive(vehicle, period, max(round(depth / ROUND) * ROUND, 30.0))
    down, up = (
        ways[np.isfinite(ways).all(axis=1)] * [sign, 1.0]
        for ways, sign in ((rows[:, 1:3], -1.0), (rows[:, 3:5], 1.0))
    )
    if not len(down) or not len(up):
        return usual
    lightest, heaviest = vehicle.net_mass_range
    # half of the difference of the pumped volumes is the net mass of each phase
    heavy, light = (vehicle.net_mass_for_pump(float(np.median(one[:, 1]))) for one in (down, up))
    pull = float(np.clip(0.5 * abs(heavy - light), 0.3 * heaviest, min(heaviest, -lightest)))
    pitch, climb_pitch = (
        round(float(np.clip(np.median(one[:, 0]), 12.0, 40.0)) / 2.0) * 2.0 for one in (down, up)
    )
    return dataclasses.replace(
        usual,
        pitch=pitch,
        climb_pitch=climb_pitch,
        net_mass=round(pull / heaviest, 1) * heaviest,
        climb_net_mass=round(pull / -lightest, 1) * -lightest,
    )
