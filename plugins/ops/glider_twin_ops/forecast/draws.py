"""Water draws: possible courses of the current, and of the errors of speed and compass."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from glider_twin_ops.forecast.current_models import FILTER, CurrentPool
from glider_twin_ops.forecast.pool import Mixture
from twin import Vehicle
from twin.identify import normal_draws
from twin.navigation.current import CALIBRATION, DIVE, MODES, CurrentFilter, Leg, passage
from twin.numbers import Array

LARGEST_SCALE = 0.5
"""A speed is never drawn further off than by this part"""


def scaled_speed(vehicle: Vehicle, scale: float) -> Vehicle:
    """The vehicle so much faster at the same weight: all forces of the water over (1 + scale)^2."""
    factor = 1.0 / (1.0 + min(max(scale, -LARGEST_SCALE), LARGEST_SCALE)) ** 2
    factors = {
        one.name: factor
        for one in vehicle.law.uncertainties()
        if one.unit == "1" and one.certain == 1.0
    }
    return vehicle.replace(law=vehicle.law.scaled(factors))


INTERVAL = 1800.0
"""[s] between two values of a course: a tenth of the time in which an inertial oscillation turns
around at 60 degree"""
FIELD_TIME = 86400.0
"""[s] after which the error of a forecast field has lost its memory: weather's"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WaterDraws:
    """Draws by member; the first member is the mean of all that is known."""

    current: Array
    """North, east [m/s], (member, time, 2), INTERVAL apart"""
    speed_scale: Array
    """[1] real speed over the model's, less 1, (member,)"""
    compass: Array
    """[rad] that true headings are beyond the compass's, (member,)"""


def draw_water(
    filter_: CurrentFilter, duration: float, count: int, rng: np.random.Generator, dive: float
) -> WaterDraws:
    """Draws of what a filter expects.

    Args:
      filter_: at the start. duration: [s]. count: of members, the mean included.
      dive: [s] after which what single dives add is another.
    """
    mean, covariance = _state(filter_)
    states = mean + np.concatenate(
        [np.zeros((1, len(mean))), normal_draws(covariance, count - 1, rng)]
    )
    times = np.arange(math.ceil(duration / INTERVAL) + 2)
    modes = states[:, MODES::2] + 1j * states[:, MODES + 1 :: 2]
    gone = passage(filter_.modes, INTERVAL)
    deviation = np.sqrt(filter_.inflation * gone.noise)
    course = np.empty((count, len(times), 2))
    added = states[:, DIVE]
    per_dive = max(1, round(dive / INTERVAL))
    for k in times:
        if k and k % per_dive == 0:
            added = filter_.parameters.dive * _scattered(rng, count, 2)
        total = modes.sum(axis=1)
        course[:, k, 0], course[:, k, 1] = total.real + added[:, 0], total.imag + added[:, 1]
        noise = _scattered(rng, count, 2 * len(deviation))
        modes = gone.kept * modes + deviation * (noise[:, ::2] + 1j * noise[:, 1::2])
    scale, compass = states[:, CALIBRATION].T
    return WaterDraws(current=course, speed_scale=scale, compass=compass)


def draw_models(
    drawn: WaterDraws, pool: CurrentPool, rng: np.random.Generator
) -> tuple[WaterDraws, float]:
    """The same draws, where each member takes one of a pool's models by its weight.

    Members of the filter keep what was drawn of it; those of another model take its course and an
    error that lasts, Student's t of the model's scale. The first member is the mean of all.

    Args:
      pool: with what it has learned, its filter at the start.

    Returns:
      The draws, and the deviation [m/s] of the currents at the start, mean of north and east.
    """
    count, steps, _ = drawn.current.shape
    points = [_around(pool.filtered.filter_.time + INTERVAL * k) for k in range(steps)]
    courses = {
        name: drawn.current[0]
        if name == FILTER
        else np.array([model.expect(point)[0] for point in points])
        for name, model in pool.models.items()
    }
    known = [name for name, course in courses.items() if np.isfinite(course).all()]
    part = np.array([pool.pool.weights[name] for name in known])
    part /= part.sum()
    taken = rng.choice(len(known), size=count, p=part)
    freedom = pool.pool.freedom
    heavy = np.sqrt(freedom / rng.chisquare(freedom, count))
    error = heavy[:, None] * rng.standard_normal((count, 2))
    course, variance = drawn.current.copy(), np.empty(len(known))
    for k, name in enumerate(known):
        if name == FILTER:
            variance[k] = _variance(pool.filtered.filter_)
            continue
        scale, mine = pool.pool.scales[name], taken == k
        variance[k] = scale**2 * freedom / (freedom - 2.0)
        course[mine] = courses[name] + scale * error[mine][:, None, :]
    course[0] = np.einsum("m,mtk->tk", part, np.array([courses[name] for name in known]))
    apart = np.array([courses[name][0] for name in known]) - course[0, 0]
    total = part @ (variance + 0.5 * (apart**2).sum(axis=1))
    return dataclasses.replace(drawn, current=course), math.sqrt(float(total))


def draw_ways(ahead: Mixture, freedom: float, count: int, rng: np.random.Generator) -> Array:
    """By how much the water seems to move faster, as a vehicle does not go as it was sent, north
    and east [m/s], (member, 2).

    Each member takes one kind of way by its weight, and an error of its scale that lasts. The first
    one has the mean of all.

    Args:
      ahead: what a pool of ways expects; the members fly the first kind that it knows.
      freedom: [1] of the pool's Student's t.
    """
    off = ahead.draw(count, freedom, rng) - ahead.means[0]
    off[0] = ahead.mean - ahead.means[0]
    return off


def _around(time: float) -> Leg:
    """An `INTERVAL` about a time [s]."""
    begin = time - 0.5 * INTERVAL
    return Leg(start=begin, duration=INTERVAL, over_ground=(0.0, 0.0), through_water=None)


def _variance(filter_: CurrentFilter) -> float:
    """[m2/s2] of the currents drawn of a filter at the start, mean of north and east."""
    _, covariance = _state(filter_)
    total = np.zeros((2, len(covariance)))
    for axis in range(2):
        total[axis, MODES + axis :: 2] = 1.0
        total[axis, DIVE.start + axis] = 1.0
    return 0.5 * float(np.trace(total @ covariance @ total.T))


def draw_field_error(
    drawn: WaterDraws,
    filter_: CurrentFilter,
    field: tuple[float, float],
    deviation: float,
    rng: np.random.Generator,
    *,
    told: bool,
) -> WaterDraws:
    """The same draws with the error of a field in place of the current.

    Args:
      field: north, east [m/s] of the field at the start, mean over the dives' depths.
      deviation: [m/s] of the field's error, north and east each.
      told: whether fixes have told the filter a current, and with it the error at the start.
    """
    seen, spread = filter_.current
    prior, gain = deviation**2 * np.eye(2), np.zeros((2, 2))
    if told:
        gain = prior @ np.linalg.inv(prior + filter_.inflation * spread)
    mean = gain @ (seen - np.array(field))
    count, steps, _ = drawn.current.shape
    kept = math.exp(-INTERVAL / FIELD_TIME)
    gained = deviation * math.sqrt(1.0 - kept**2)
    error = mean + np.concatenate(
        [np.zeros((1, 2)), normal_draws(prior - gain @ prior, count - 1, rng)]
    )
    course = np.empty((count, steps, 2))
    for k in range(steps):
        course[:, k] = error
        error = kept * error + gained * _scattered(rng, count, 2)
    return dataclasses.replace(drawn, current=course)


def calibration_deviation(filter_: CurrentFilter) -> tuple[float, float]:
    """Of the drawn errors of the speed [1] and of the compass [rad]."""
    _, covariance = _state(filter_)
    scale, compass = np.sqrt(np.diag(covariance)[CALIBRATION])
    return float(scale), float(compass)


def _state(filter_: CurrentFilter) -> tuple[Array, Array]:
    """Mean and covariance of the state, as the filter's own forecasts spread it."""
    state = filter_.state()
    return state["mean"], filter_.inflation * state["covariance"]


def _scattered(rng: np.random.Generator, count: int, size: int) -> Array:
    """Standard normal draws, (count, size); none for the first member."""
    draws = rng.standard_normal((count, size))
    draws[0] = 0.0
    return draws
