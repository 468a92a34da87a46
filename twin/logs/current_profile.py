"""Current profile: absolute current against depth, by the cells of a vehicle's Doppler log.

Velocities over ground are unknown at every sample, and so are the currents at nodes of depth,
linear between them. One least-squares problem holds (inverse method: Visbeck 2002, J. Atmos.
Oceanic Technol. 19, 794-807; for gliders Todd et al. 2017, J. Atmos. Oceanic Technol. 34, 309-333):

    cells         velocity = current at the cell + velocity past the cell
    flight model  velocity = current at the vehicle + velocity through the water
    bottom track  velocity = velocity over the bottom, where the log has it
    fixes         sum of velocity times period = displacement

Further unknowns, with priors, are errors that do not average out: the compass' offset, a bias of
cells with range (it looks like shear), and the model's speed in descents and in climbs. Velocities
are eliminated sample by sample, which is exact, so that a small normal matrix remains. Horizontal
vectors are complex numbers here: north + i east.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.sparse import csr_array, hstack, kron

from twin.frames import euler_to_matrix
from twin.identify.calibration import Array, Calibration
from twin.logs.corrected_track import HEADING_DEVIATION, SPEED_DEVIATION, DiveCurrent
from twin.logs.flight_estimator import FlownDive
from twin.logs.track import GPS_DEVIATION
from twin.records.logged import CELLS
from twin.records.reader import MissionStore

SHEAR, SHEAR_HEIGHT, ANY_CURRENT, RANGE_BIAS = 0.01, 10.0, 2.0, 5e-4
"""Prior standard deviations. SHEAR: [1/s] over SHEAR_HEIGHT [m]. ANY_CURRENT: [m/s] mean current.
RANGE_BIAS: [1/s] cells' bias along the heading for each metre of range."""
CORRELATION_TIME, UNKNOWN_SPEED = 300.0, 0.5
"""CORRELATION_TIME: [s] time within which the flight model's error is one. UNKNOWN_SPEED: [m/s]
standard deviation without attitude."""
CELL_DEVIATION, MOST_NODES, BLOCK = 0.05, 100, 60.0
"""CELL_DEVIATION: [m/s] standard deviation of cells before the fit. MOST_NODES: maximum number of
nodes. BLOCK: [s] time within which cells err alike."""
OVER_BOTTOM = ("bottom_surge", "bottom_sway", "bottom_heave", "roll", "pitch")
MODEL, BOTTOM = -1, -2
"""Sources of rows beside the cells, which are numbered from 0."""
ROUNDS, OUTLIER, ROBUST = 4, 3.0, 1.4826
"""ROUNDS: number of fits. OUTLIER: standard deviations from which residuals weigh less (Huber).
ROBUST: standard deviation over median absolute deviation."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentProfile:
    """Current against depth of one dive between two fixes."""

    depth: Array
    """[m] Depths of the nodes, increasing, (node,)"""
    current: Array
    """[m/s] North and east, (node, 2)"""
    deviation: Array
    """[m/s] Standard deviations of north and east, (node, 2)"""


def current_profile(
    store: MissionStore, dive: FlownDive, calibration: Calibration, between: DiveCurrent
) -> CurrentProfile | None:
    """Solve for the profile of one dive; None without cells. Residuals show the noise of each
    cell, and by how much the cells of a minute err alike.

    Args:
      dive: velocity through the water of the mission, whose depth-averaged current is `between`.
      calibration: gives the compass' deviation.
    """
    if any(name not in store for name in CELLS):
        return None
    part, period = slice(between.first, between.last + 1), store.period
    names = (*CELLS, "measured_heading")
    read = (store.row(name, dive.mission)[part].astype(float) for name in names)
    ahead, starboard, below, heading = read
    heading = calibration.true_heading(np.radians(heading))
    time, cell = np.nonzero(np.isfinite(ahead) & np.isfinite(heading)[:, None])
    if not len(time):
        return None
    # a row for each sample by the flight model, then for each velocity of a cell, of bottom track
    count, turn = len(ahead), np.exp(1j * np.nan_to_num(heading))
    bottom = _over_bottom(store, dive)[part] * turn
    locked = np.flatnonzero(np.isfinite(bottom))
    sample = np.concatenate([np.arange(count), time, locked])
    source = np.concatenate([np.full(count, MODEL), cell, np.full(len(locked), BOTTOM)])
    model, water = source == MODEL, dive.velocity[part] @ [1.0, 1.0j]
    past = (ahead + 1j * starboard)[time, cell] * turn[time]
    velocity = np.concatenate([water, past, bottom[locked]])
    reach = np.concatenate([np.zeros(count), below[time, cell], np.zeros(len(locked))])
    known = np.isfinite(heading if dive.motion is None else heading + dive.motion.surge[part])
    repeats = math.sqrt(max(2.0 * CORRELATION_TIME / period, 1.0))
    deviation = np.full(len(sample), CELL_DEVIATION)
    deviation[model] = repeats * np.where(known, SPEED_DEVIATION, UNKNOWN_SPEED)
    legs = [model & leg[part][sample] for leg in (dive.descending, dive.ascending)]
    errors = turn[sample] * np.stack([np.abs(reach), *legs])
    # shares of the nodes' currents in each row
    at = np.maximum(dive.depth[part][sample] + reach, 0.0)
    steps = np.abs(np.diff(below, axis=1))
    height = max(float(np.nanmedian(steps)) if np.isfinite(steps).any() else 1.0, 0.1)
    nodes = int(np.clip(round(float(np.ptp(at)) / height) + 1, 2, MOST_NODES))
    depth, height = np.linspace(at.min(), at.max(), nodes, retstep=True)
    place = (at - depth[0]) / height
    node = np.clip(place.astype(np.int64), 0, nodes - 2)
    where = np.tile(np.arange(len(at)), 2), np.append(node, node + 1)
    share = np.append(1.0 - place + node, place - node) * np.tile(source != BOTTOM, 2)
    linear = csr_array((share, where), shape=(len(at), nodes))
    slope = np.diff(np.eye(nodes), axis=0) / (SHEAR * math.sqrt(height * max(SHEAR_HEIGHT, height)))
    inverse = slope.T @ slope + np.eye(nodes) / (nodes * ANY_CURRENT**2)
    of_errors = np.array([HEADING_DEVIATION, RANGE_BIAS, SPEED_DEVIATION, SPEED_DEVIATION])
    prior = block_diag(inverse, inverse, np.diag(of_errors**-2.0))
    row = np.append(sample, sample + count)
    each = period * np.concatenate([[0.5], np.ones(count - 2), [0.5]])
    over = between.duration * (between.north + 1j * between.east) + each @ water
    block = np.unique(source + 1j * (period * sample // BLOCK), return_inverse=True)[1]
    value = np.append(velocity.real, velocity.imag)
    smooth, weaker = water[sample], np.ones(len(sample))
    for _ in range(ROUNDS):
        columns = np.stack([1j * smooth, *errors])  # noise would look like knowledge of the compass
        dense = csr_array(np.concatenate([columns.real, columns.imag], axis=1).T)
        matrix = hstack([kron(np.eye(2), linear), dense], format="csr")
        weight = np.tile(weaker / deviation**2, 2)
        total = np.bincount(row, weight)
        mean = csr_array((weight / total[row], (row, np.arange(len(row)))))
        middle, level = mean @ matrix, mean @ value
        normal = (matrix.T @ matrix.multiply(weight[:, None])).toarray() + prior
        normal -= (middle.T @ middle.multiply(total[:, None])).toarray()
        right = middle.T @ (total * level) - matrix.T @ (weight * value)
        for own, moved in ((slice(count), over.real), (slice(count, None), over.imag)):
            closing, missing = each @ middle[own], moved - float(each @ level[own])
            variance = 2.0 * GPS_DEVIATION**2 + float((each**2 / total[own]).sum())
            normal += np.outer(closing, closing) / variance
            right += closing * missing / variance
        factor = cho_factor(normal)
        found = cho_solve(factor, right)
        missed = (matrix @ found + value - (middle @ found + level)[row]).reshape(2, -1)
        smooth = velocity - missed[0] - 1j * missed[1]
        missed /= np.sqrt(np.maximum(1.0 - weight / total[row], 1e-3)).reshape(2, -1)
        for one in np.unique(source[~model]):
            noise = ROBUST * float(np.median(np.abs(missed[:, source == one])))
            deviation[source == one] = max(noise, 1e-3)
        scores = missed / deviation * ~model
        weaker = OUTLIER / np.maximum(np.abs(scores).max(axis=0), OUTLIER)
        scores *= weaker
        sums = sum(float((np.bincount(block, one) ** 2).sum()) for one in scores)
        deviation[~model] *= math.sqrt(max(sums / float((scores**2).sum()), 1.0))
    spread = np.sqrt(np.diag(cho_solve(factor, np.eye(len(found)))))
    current, deviations = (v[: 2 * nodes].reshape(2, -1).T for v in (found, spread))
    return CurrentProfile(depth=depth, current=current, deviation=deviations)


def _over_bottom(store: MissionStore, dive: FlownDive) -> NDArray[np.complex128]:
    """Velocity over the bottom [m/s], ahead + i starboard in level axes, (time,); NaN where the
    log has none."""
    names = tuple(f"measured_{name}" for name in OVER_BOTTOM)
    if any(name not in store for name in names):
        return np.full(len(dive.depth), complex(np.nan))
    *body, roll, pitch = (store.row(name, dive.mission).astype(float) for name in names)
    level = euler_to_matrix(*np.radians([roll, pitch, np.zeros_like(roll)]))
    return np.einsum("k,tkj,jt->t", [1.0, 1.0j, 0.0], level, body)
