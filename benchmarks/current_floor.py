"""Current floor: position errors at fixes for a navigator that knows the currents' distribution.

    python -m benchmarks.current_floor STORE [STORE ...] --learn STORE [STORE ...] [--seas 400]
        [--json]

Stores are of preset `field`, as in `benchmarks.navigator_consistency`, which gives their dives. For
each mission, currents are sampled from the store's own distribution, each also turned by 36 angles
of equal probability. A sample's weight is the likelihood of the fixes so far (importance sampling).
The errors of the track through the water are fitted to the missions after `--learn`: scale and turn
of a mission, noise of a dive. The weighted mean predicts the next fix. No estimate from fixes alone
is better, up to the sampling error; half of the samples are tried too.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks import command
from benchmarks.navigator_consistency import legs_of
from factory.generation.generated_store import GeneratedStore
from factory.sampling.conditions import build_current
from factory.sampling.draw import Parameters, draw_values
from learn.data.dataset import Selection
from twin.navigation.current import Leg
from twin.navigation.navigator import ATTITUDE, DEPTH, FIX, RATES
from twin.seams import VELOCITY_ESTIMATORS
from twin.water.current.axes import Origin
from twin.water.current.sampler import sample_track

Array = NDArray[np.float64]

METHOD = "steady_flight"
SEA_SEED = 990_417
"""Seed of the sampled currents, not used by any store"""
EVERY = 60.0
"""[s] Time between the points of a dive at which the current is sampled"""
TURNS = np.exp(2j * np.pi * np.arange(36) / 36)
AT_FIRST = (0.05, 0.05, 10.0)
"""Scale [1], turn [rad] and noise [m] at which their fit starts"""


@dataclasses.dataclass(frozen=True)
class Dives:
    """Dives of one mission: displacements north + i east [m], (dive,)."""

    over_ground: NDArray[np.complex128]
    way: NDArray[np.complex128]
    current: NDArray[np.complex128]
    """Displacement by the true current"""
    seas: NDArray[np.complex128]
    """Displacement by each sampled current, (sea, dive)"""


def dives_of(store: str, seas: int) -> Iterator[Dives]:
    """Dives of each mission with known tracks."""
    with GeneratedStore(store) as generated:
        kind = VELOCITY_ESTIMATORS[METHOD]
        # a current from the store's distribution, at the mission's own place and plan
        names = [name for name in generated.table if name.startswith("current.")]
        draw = functools.partial(
            draw_values, {name: generated.table[name] for name in names}, generated.distributions,
            seed=SEA_SEED, attempt=0,
        )  # fmt: skip
        drawn_seas = [draw(mission=number) for number in range(seas)]
        channels = (DEPTH, *ATTITUDE, *FIX, *RATES, *kind.needs(generated.vehicle), "true_depth")
        with Selection(store, list(dict.fromkeys(channels))) as selection:
            method = kind(generated.vehicle, selection.period)
            for mission in selection.each():
                found = method.batch(mission.signals)
                legs = legs_of(mission, found.surge, found.sway)
                legs = [leg for leg in legs if leg.through_water is not None]
                if not legs:
                    continue
                own = generated.parameters(mission.index)
                track = (mission.period, np.asarray(mission.signals["true_depth"], dtype=float))
                drawn = [
                    _carried(dataclasses.replace(own, values={**own.values, **sea}), legs, track)
                    for sea in drawn_seas
                ]
                yield Dives(
                    over_ground=np.array([complex(*leg.over_ground) for leg in legs]),
                    way=np.array([complex(*leg.through_water) for leg in legs]),
                    current=_carried(own, legs, track),
                    seas=np.array(drawn),
                )


def _carried(
    parameters: Parameters, legs: Sequence[Leg], track: tuple[float, Array]
) -> NDArray[np.complex128]:
    """Displacement north + i east [m] of a mission by a sea's current in each dive."""
    water = build_current(parameters)
    if water is None:
        return np.zeros(len(legs), dtype=complex)
    period, depth = track
    place = Origin(
        latitude_deg=parameters.number("water.latitude"),
        longitude_deg=parameters.number("water.longitude"),
    )
    program = water.compile(parameters.duration_s, place)
    times = [
        np.linspace(leg.start, leg.end, max(2, round(leg.duration / EVERY) + 1)) for leg in legs
    ]
    t = np.concatenate(times)
    at = np.minimum(np.rint(t / period).astype(int), len(depth) - 1)
    rest = np.zeros_like(t)
    velocity = sample_track(program, t, rest, rest, depth[at], rest, rest, rest)[:, :2]
    whole = velocity @ np.array([1.0, 1j])
    ends = np.cumsum([len(one) for one in times])[:-1]
    return np.array([
        leg.duration * np.trapezoid(part, dx=1.0) / (len(part) - 1)
        for leg, part in zip(legs, np.split(whole, ends), strict=True)
    ])  # fmt: skip


def way_errors(missions: Sequence[Dives]) -> Array:
    """Maximum-likelihood standard deviations of scale [1], turn [rad] and noise [m]."""

    def unlikely(logarithms: Array) -> float:
        size = np.exp(logarithms)
        return -sum(
            _log_density(one.over_ground - one.way - one.current, _covariance(one.way, size))
            for one in missions
        )

    return np.exp(minimize(unlikely, np.log(AT_FIRST), method="Nelder-Mead").x)


def _covariance(way: NDArray[np.complex128], size: Array) -> Array:
    """[m^2] Covariance of the tracks' errors, north then east of all dives, (2 dive, 2 dive)."""
    along = np.concatenate([way.real, way.imag])
    across = np.concatenate([-way.imag, way.real])
    scale, turn, noise = size
    return (
        scale**2 * np.outer(along, along)
        + turn**2 * np.outer(across, across)
        + noise**2 * np.eye(len(along))
    )


def _log_density(off: NDArray[np.complex128], covariance: Array) -> Any:
    """Log density of normal errors (..., dive), without its constant."""
    errors = np.concatenate([off.real, off.imag], axis=-1)
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, errors[..., None])[..., 0]
    return -0.5 * (white**2).sum(-1) - np.log(np.diag(root)).sum()


def misses_of(one: Dives, size: Array, seas: int) -> Array:
    """[m] Error of the prediction at each fix, (dive,)."""
    known = (one.seas[:seas, None, :] * TURNS[:, None]).reshape(-1, len(one.way))
    off = one.over_ground - one.way
    full, count = _covariance(one.way, size), len(one.way)
    found = []
    for k in range(count):
        before = [*range(k), *range(count, count + k)]
        said = known[:, k]
        weights = np.full(len(known), 1.0 / len(known))
        if k:
            errors = off[:k] - known[:, :k]
            inner = full[np.ix_(before, before)]
            logs = _log_density(errors, inner)
            weights = np.exp(logs - logs.max())
            weights /= weights.sum()
            gain = np.linalg.solve(inner, full[np.ix_(before, [k, count + k])])
            told = np.concatenate([errors.real, errors.imag], axis=-1) @ gain
            said = said + told @ np.array([1.0, 1j])
        found.append(abs(off[k] - weights @ said))
    return np.array(found)


def floor_of(judged: Sequence[Dives], size: Array, seas: int) -> dict[str, float]:
    """Mean errors [m], and those of persistence on the same dives."""
    every = [misses_of(one, size, seas) for one in judged]
    later = np.concatenate([one[1:] for one in every])
    currents = [one.over_ground - one.way for one in judged]
    return {
        "first_dive_m": float(np.mean([one[0] for one in every])),
        "later_m": float(later.mean()),
        "fixes": int(sum(len(one) for one in every)),
        "first_dive_no_current_m": float(np.mean([abs(one[0]) for one in currents])),
    }


def main(
    stores: command.Positional[tuple[str, ...]],
    *,
    learn: tuple[str, ...],
    seas: int = 400,
    json: bool = False,
) -> None:
    """Print the floor.

    Args:
      stores: missions of preset field.
      learn: stores to which the track's errors are fitted.
      seas: currents sampled for a mission.
    """
    taught = [one for store in learn for one in dives_of(store, 0)]
    size = way_errors(taught)
    judged = [one for store in stores for one in dives_of(store, seas)]
    figures = {
        **dict(zip(("way_scale", "way_turn_rad", "way_noise_m"), map(float, size), strict=True)),
        **floor_of(judged, size, seas),
        "later_half_of_the_seas_m": floor_of(judged, size, seas // 2)["later_m"],
    }
    command.say(figures, [{"figure": k, "value": v} for k, v in figures.items()], json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
