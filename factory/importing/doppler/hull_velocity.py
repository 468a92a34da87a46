"""Hull velocity: what a Doppler log says of a hull through the water, in the hull's own axes.

Cells near the hull are screened and averaged, the mount's tilt is found by closure and turned out,
and each component gets a standard deviation: the noise that the error velocity shows, what the tilt
leaves, and the part of the speed that does not close.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import gsw
import numpy as np
from scipy.ndimage import median_filter

from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.doppler.closure import (
    DEEP,
    ROBUST,
    Closure,
    closes,
    depth_rate,
    downward,
    fit_tilt,
    tilted,
)
from factory.importing.doppler.pd0 import Array, Ensembles
from factory.importing.doppler.relative_velocity import (
    SHIP,
    Mask,
    RelativeVelocity,
    axes_of,
    relative_velocity,
)
from factory.importing.doppler.screens import Thresholds, screen, screen_cells
from factory.importing.pressures import pressure_of
from twin.errors import InputError
from twin.frames import euler_to_matrix

NEIGHBOURS = 51
"""Ensembles whose error velocities give the noise of the middle one."""
CLOSER = 0.8
"""Residual in other axes, over that in those that the file states, below which these are taken."""
FEWEST = 30
"""Minimum number of ensembles with water and bottom track that can contradict each other."""
CURRENT, LOST, LEAST = 3.0, 0.3, 0.1
"""[m/s] Fastest current; share of the hull's speed, and [m/s] speed, that water track may lack
against bottom track."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HullVelocity:
    """Velocities of a hull, ensemble by ensemble, in time order."""

    log: RelativeVelocity
    """What the Doppler log measured, in its own axes."""
    water: Array
    """[m/s] Through the water, in hull axes, (ensembles, 3); NaN where it was screened out."""
    deviation: Array
    """[m/s] Standard deviation of its components, (ensembles, 3)."""
    cells: Array
    """Signals of `twin.records.logged.CELLS`, (ensembles, cells, 3); NaN where screened out."""
    bottom: Array
    """[m/s] Over ground, in hull axes, (ensembles, 3)."""
    pitch: Array
    """[rad] Pitch of the hull."""
    depth: Array
    """[m] Depth of the hull."""
    closure: Closure
    dropped: dict[str, int]
    """Ensembles that each screen dropped, by its name."""
    sound: float
    """Median factor by which the speed of sound corrected velocities; 1 without a CTD."""
    swapped: bool = False
    """True if ship axes are level, or not, against the file's word."""

    @property
    def kept(self) -> Mask:
        """True for ensembles with a velocity through the water."""
        return np.asarray(np.isfinite(self.water).all(axis=1))


def hull_velocity(
    name: str, layouts: Sequence[Ensembles], vehicle: DeploymentLog | None, limits: Thresholds
) -> HullVelocity:
    """Find a hull's velocity from the ensembles of one or several files.

    Args:
      name: of the files, for errors.
      layouts: ensembles, by the vehicle's clock.
      vehicle: log with attitude and depth, and a CTD if it has one; None takes the file's.
      limits: limits of the screens.

    Raises:
      InputError: no water track, none that is good, or one that contradicts the bottom track.
    """
    found = _measured(name, relative_velocity(layouts), vehicle, limits)
    if any((axes_of(one) == SHIP).any() for one in layouts):
        # some vehicles put their tilts into the file and not into the transform
        level = not found.log.turned.any()
        other = _measured(name, relative_velocity(layouts, level=level), vehicle, limits)
        if other.closure.residual < CLOSER * found.closure.residual:
            found = dataclasses.replace(other, swapped=True)
    _check_bottom(name, found)
    return found


def _measured(
    name: str, log: RelativeVelocity, vehicle: DeploymentLog | None, limits: Thresholds
) -> HullVelocity:
    """Screen, close and turn one reading of a file's axes."""
    roll, pitch, depth = np.radians(log.roll), np.radians(log.pitch), log.depth
    known, sound = Channel.finite(log.time, depth), np.ones(len(log))
    if vehicle is not None:
        own = np.radians(vehicle.channel("measured_roll").known(log.time))
        roll = np.where(np.isfinite(own), own, roll)
        pitch = np.radians(vehicle.channel("measured_pitch").known(log.time))
        known = vehicle.channel("measured_depth")
        depth = known.known(log.time)
        sound = _sound_factor(log, vehicle, depth)
    rate = depth_rate(known.time, known.values, log.time)
    water, error, dropped = screen(log, limits)
    water = water * sound[:, None]
    closure = fit_tilt(log.time, water, roll, pitch, rate, depth)
    turned = tilted(water, closure.tilt)
    down = downward(turned, roll, pitch)
    judged = np.isfinite(down + rate)
    dropped["closure"] = judged.copy()
    dropped["closure"][judged] = ~closes(
        log.time[judged], turned[judged], down[judged], rate[judged], limits.closure
    )
    water[dropped["closure"]] = np.nan
    counts = {screen: int(mask.sum()) for screen, mask in dropped.items()}
    if not np.isfinite(water).any():
        _refuse_empty(name, log, counts)
    closure = fit_tilt(log.time, water, roll, pitch, rate, depth)
    water = tilted(water, closure.tilt)
    kept = np.where(np.isfinite(water[:, 0]), sound, np.nan)
    cells = screen_cells(log, limits) * kept[:, None, None]
    cells = tilted(cells.reshape(-1, 3), closure.tilt).reshape(cells.shape)
    cells = np.einsum("tij,tcj->tci", euler_to_matrix(roll, pitch, 0.0 * roll), cells)
    # the third component shows closure alone; the depth below the hull takes its place
    below = log.cells[..., 7] * (np.cos(pitch + closure.tilt) * np.cos(roll))[:, None]
    cells[..., 2] = np.where(np.isfinite(cells[..., 0]), below, np.nan)
    return HullVelocity(
        log=log,
        water=water,
        deviation=_deviation(water, error, log.beam_angle, closure),
        cells=cells,
        bottom=tilted(log.bottom * sound[:, None], closure.tilt),
        pitch=pitch,
        depth=depth,
        closure=closure,
        dropped=counts,
        sound=float(np.median(sound)),
    )


def _sound_factor(log: RelativeVelocity, vehicle: DeploymentLog, depth: Array) -> Array:
    """Speed of sound by the vehicle's CTD over that of the Doppler log; 1 where it is unknown."""
    warm, salt = (
        vehicle.channel(f"measured_{name}").known(log.time) for name in ("temperature", "salinity")
    )
    latitude, longitude = vehicle.fixes.middle
    dbar = pressure_of(depth, latitude)
    absolute = gsw.SA_from_SP(salt, dbar, longitude, latitude)
    speed = gsw.sound_speed(absolute, gsw.CT_from_t(absolute, warm, dbar), dbar)
    factor = speed / np.where(log.sound_speed > 0.0, log.sound_speed, np.nan)
    return np.where(np.isfinite(factor), factor, 1.0)


def _deviation(water: Array, error: Array, beam_angle: Array, closure: Closure) -> Array:
    """Standard deviations [m/s] of velocities through the water, (ensembles, 3).

    With four beams the error velocity has the noise of surge and sway; that of heave is smaller.
    """
    noise = np.full(len(water), np.nan)
    kept = np.isfinite(water).all(axis=1)
    spread = ROBUST * median_filter(np.abs(error[kept]), NEIGHBOURS, mode="nearest")
    noise[kept] = np.maximum(spread, 1e-3)  # the file's resolution
    vertical = noise * np.tan(np.radians(beam_angle)) / np.sqrt(2.0)
    scale = np.hypot(closure.scale - 1.0, closure.scale_deviation)
    own = np.stack([noise, noise, vertical], axis=1)
    across = closure.tilt_deviation * water[:, ::-1] * [1.0, 0.0, 1.0]
    return np.sqrt(own**2 + (scale * water) ** 2 + across**2)


def _refuse_empty(name: str, log: RelativeVelocity, dropped: dict[str, int]) -> None:
    """Raise the error for a record without any velocity through the water."""
    if not np.isfinite(log.water).all(axis=2).any():
        bottom = int(np.isfinite(log.bottom).all(axis=1).sum())
        what = f"has bottom track alone ({bottom} ensembles)" if bottom else "has no velocity"
        raise InputError(
            f"{name} {what}: none of its {len(log)} ensembles has a cell of water track within "
            "reach. A hull's velocity through the water needs cells (commands WN, WS, WP); a "
            "velocity over ground goes into a csv table with dvl_lock = 'bottom'"
        )
    why = ", ".join(f"{count} by {screen}" for screen, count in dropped.items() if count)
    raise InputError(
        f"{name}: no ensemble of {len(log)} is good: dropped are {why}. Was the log in air, or "
        "its echo too weak?"
    )


def _check_bottom(name: str, found: HullVelocity) -> None:
    """Refuse a water track that no current explains beside the bottom track.

    The difference of both is a current: it neither turns with the hull nor is vertical.

    Raises:
      InputError: the difference is too large, or goes with the hull.
    """
    log = found.log
    use = np.isfinite(found.water + found.bottom).all(axis=1) & (found.depth > DEEP)
    if use.sum() < FEWEST:
        return
    roll, pitch, heading = (np.radians(a[use]) for a in (log.roll, log.pitch, log.heading))
    turn = euler_to_matrix(roll, pitch, heading)
    over, through = (np.einsum("tij,tj->ti", turn, v[use]) for v in (found.bottom, found.water))
    current = over - through
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    speed = float(np.median((over[:, :2] * ahead).sum(axis=1)))
    share, error = _slope(speed * ahead, current[:, :2])
    fast = float(np.median(np.hypot(*current[:, :2].T)))
    sunk, rest = (float(np.mean(np.sign(over[:, 2]) * v[:, 2])) for v in (over, current))
    why = ""
    if fast > CURRENT:
        why = f"they differ by {fast:.2f} m/s (median), and no current is so fast"
    elif abs(share) - 2.0 * error > LOST and abs(share * speed) > LEAST:
        why = (
            f"over ground the hull moves at {speed:.2f} m/s, and {share:.0%} (+- {error:.0%}) of "
            "that is missing through the water on every heading, as no current does"
        )
    elif sunk > 0.5 * LEAST and abs(rest) > LOST * sunk:
        why = f"of {sunk:.3f} m/s up and down over ground {rest:.3f} m/s are missing in the water"
    if why:
        raise InputError(
            f"{name}: its water track contradicts its bottom track in {int(use.sum())} ensembles: "
            f"{why}. The cells may hold the bottom's or the vehicle's own echo; leave the file out"
        )


def _slope(ahead: Array, difference: Array) -> tuple[float, float]:
    """Slope of two components together about their means, and its standard deviation with ten
    independent parts."""
    ahead, difference = ahead - ahead.mean(axis=0), difference - difference.mean(axis=0)
    weight = float((ahead**2).sum())
    if weight < 1e-6 * len(ahead):
        return 0.0, np.inf
    slope = float((ahead * difference).sum()) / weight
    left = (ahead * (difference - slope * ahead)).sum(axis=1)
    parts = [float(part.sum()) for part in np.array_split(left, 10)]
    return slope, float(np.linalg.norm(parts)) / weight
