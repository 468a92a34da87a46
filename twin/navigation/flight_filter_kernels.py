"""Flight filter kernels: one sample after the other, compiled.

`samples` hold CHANNELS, `carried` is all that goes from one sample to the next: its places have
names here.
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import jit
from twin.identify.speed import balanced_forces
from twin.navigation.dead_reckoning import RESTING_RATE, SHALLOW_DEPTH, SURFACE_DEPTH
from twin.vehicle.laws.flow_frame import CROSS_FLOW, K_ALPHA, K_D, K_D0, LINEAR, native_wrench
from twin.vehicle.parts.pump import CUBIC_CM
from twin.water.density import STANDARD_OCEAN

CHANNELS = (
    *("measured_depth", "measured_roll", "measured_pitch"),
    *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate"),
    *("measured_specific_force_x", "measured_specific_force_y", "measured_specific_force_z"),
    *("measured_pump", "measured_density"),
)
"""Channels of a sample, in their order."""
DEPTH, ROLL, PITCH, P, Q, R, FX, FY, FZ, PUMP, DENSITY = range(len(CHANNELS))
CONSTANTS = ("drag", "lift_slope", "pitch_x", "pitch_z", "ballast", "compressibility", "induced")
DRAG, LIFT, TILT_X, TILT_Z, BALLAST, SQUEEZE, INDUCED = range(len(CONSTANTS))
OUTPUTS = ("surge", "sway", "attack", "steady", "surge_sd")
"""Outputs for each sample: surge and sway [m/s], the angle of attack [rad], 1 where
the glide is steady as the balance takes it, and the deviation [m/s] that the constants leave to
surge. The angle is held to 0.3 rad either way: stalled or tail first it says the side alone."""
SMOOTHED_S = 5.0
"""[s] exponential mean of what the balance reads: longer than noise, shorter than a glider takes to
settle."""
PROMPT_S = 1.0
"""[s] exponential mean of pitch and depth rate afloat, where a hull that comes up turns by 100
degrees in ten seconds: both lag alike, and little."""
PROMPT_RATE = 0.02
"""[m/s] by which the depth rate's prompt mean must differ from the other to be taken: less is noise
of the depth, and heaving by that would row a hull forward with its wings."""
FUSED_S = 20.0
"""[s] over which the attitude's pitch is drawn to the accelerometers'."""
QUIET_S = 10.0
"""[s] over which the glide must have been steady."""
QUIET_PITCH = math.radians(1.0)
"""[rad] by which the pitch may then differ from its mean."""
QUIET_RATE = 0.01
"""[m/s] likewise, of the depth rate."""
AFLOAT_S = 40.0
"""[s] after a stay at the surface in which nothing is learned."""
EVERY_S = 15.0
"""[s] between corrections; a glider's errors of one moment last about as long."""
ITERATIONS = 12
"""Fixed-point iterations of a balance."""
STEP_S = 0.125
"""[s] at most, of the motion: a hull settles to its angle of attack in half a second or more."""
FASTEST = 3.0
"""[m/s] along each axis of the hull; more is a channel that is wrong."""
RELINEARISED = 2
"""Times that a correction is worked out, each about the last one's constants."""
NUDGE = 0.1
"""Step of the differences, over the prior deviation."""
FLAT_SINE = 0.07
"""Sine of the path angle at which the buoyancy's and the depth rate's speed count alike, as of
`steady_flight`."""
LEAST_SINE = 0.12
"""of the path angle of a glide from which something is learned"""
LEAST_SURGE = 0.05
"""[m/s] below which its deviation is no longer relative"""
LEAST_NET = 0.05
"""[kg] Net buoyancy below which an exponential replaces it. It stays positive even if buoyancy
seems to pull the wrong way, so that the ballast is still learned."""
WIDEST = 0.3
"""[rad] flow angles are held within this; half of it starts over."""
MOST_OFFSET = 0.02
"""[rad] between attitude and accelerometers; more is an acceleration."""

STARTED, BEFORE, OFFSET = 0, 1, 2
MEANS = 3
"""place of the means of pitch, roll, three rates, net mass, its change with compressibility, and
depth rate"""
RESTLESS, SLOW_RATE, SINCE_AFLOAT, SINCE_UPDATE = 11, 12, 13, 14
VELOCITY, SUNK = 15, 18
"""places of the motion's velocity [m/s] along the hull's axes, and of the mean of its depth rate"""
SPREAD = 19
"""place of the deviation of surge over surge, by the constants; worked out at each correction"""
PROMPT_PITCH, PROMPT_SINKS = 20, 21
"""places of the means over PROMPT_S of pitch and depth rate"""
GUESS = 22
COVARIANCE = GUESS + len(CONSTANTS)
CARRIED = COVARIANCE + len(CONSTANTS) ** 2
RATE, PLACE, LEARNED = 7, 8, 9
"""Places in a glide behind its seven means: depth rate [m/s], sample; number of columns"""


@jit
def _pitch(x, c):  # type: ignore[no-untyped-def]
    """Pitch [rad] without the accelerometers' errors."""
    return x[0] - (c[TILT_X] * math.cos(x[0]) + c[TILT_Z] * math.sin(x[0]))


@jit
def _balance(model, x, c, start, out):  # type: ignore[no-untyped-def]
    """Speed, angle of attack, sideslip and the downward part of the direction, into `out`.

    `model` is a `FlightFilterModel`, here as below; `x` are pitch, roll, three rates, net mass and
    its change with compressibility; `c` the constants; `start` speed and angles to start from.
    False where nothing pulls along the hull.
    """
    law = model.law
    drag, induced = law[0] * math.exp(c[DRAG]), law[1] * math.exp(c[INDUCED])
    own = drag, induced, law[2], law[3] * math.exp(c[LIFT]), law[4], WIDEST
    pitch = _pitch(x, c)
    sp, cp = math.sin(pitch), math.cos(pitch)
    sr, cr = math.sin(x[1]), math.cos(x[1])
    net = x[5] + c[BALLAST] + x[6] * c[SQUEEZE]
    sense = -1.0 if sp > 0.0 else 1.0
    if sense * net < LEAST_NET:
        net = sense * LEAST_NET * math.exp(sense * net / LEAST_NET - 1.0)
    weight = model.hull[2] * net
    forces = -weight * sp, weight * cp * sr, weight * cp * cr
    speed, alpha, beta = start[0], start[1], start[2]
    if abs(alpha) > 0.5 * WIDEST or abs(beta) > 0.5 * WIDEST:
        speed, alpha, beta = 0.3, 0.0, 0.0
    turning = x[2], x[3], x[4]
    for _ in range(ITERATIONS):
        along, speed, alpha, beta = balanced_forces(
            model.inertia, own, forces, turning, speed, alpha, beta
        )
        if along <= 1e-6:
            return False
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    out[0], out[1], out[2] = speed, alpha, beta
    out[3] = -ca * cb * sp + sb * cp * sr + sa * cb * cp * cr
    return True


@jit
def _gives(out, rate):  # type: ignore[no-untyped-def]
    """Surge [m/s] of a balance at a depth rate, which has the say where the path is steep; without
    one, NaN, the depth rate of the balance."""
    if rate != rate:
        return out[0] * out[3]
    speed = (out[0] * FLAT_SINE**2 + rate * out[3]) / (FLAT_SINE**2 + out[3] * out[3])
    return max(speed, 0.0) * math.cos(out[1]) * math.cos(out[2])


@jit
def _slopes(model, x, c, start, rate, found, out):  # type: ignore[no-untyped-def]
    """Value of `_gives`, and its change with each constant into `found`, (7,); `out` is the balance
    of `c` again."""
    for j in range(c.size):
        kept, nudge = c[j], NUDGE * model.prior[j]
        c[j] += nudge
        _balance(model, x, c, start, out)
        found[j] = _gives(out, rate) / nudge
        c[j] = kept
    _balance(model, x, c, start, out)
    here = _gives(out, rate)
    for j in range(c.size):
        found[j] -= here / (NUDGE * model.prior[j])
    return here


@jit
def _spread(model, x, c, cov, rate, start, slopes, out):  # type: ignore[no-untyped-def]
    """Deviation of surge over surge that the constants leave."""
    surge, variance = _slopes(model, x, c, start, rate, slopes, out), 0.0
    for i in range(c.size):
        for j in range(c.size):
            variance += slopes[i] * cov[i, j] * slopes[j]
    return math.sqrt(max(variance, 0.0)) / max(surge, LEAST_SURGE)


@jit
def balanced(model, glides, c, found):  # type: ignore[no-untyped-def]
    """Depth rate and level forward speed [m/s] of steady glides (n, LEARNED), into `found` (n, 2);
    NaN where nothing pulls along the hull."""
    start, out = np.zeros(3), np.zeros(4)
    for k in range(glides.shape[0]):
        x = glides[k]
        start[:] = 0.0
        if not _balance(model, x, c, start, out):
            found[k, 0] = found[k, 1] = math.nan
            continue
        pitch = _pitch(x, c)
        normal = math.sin(out[2]) * math.sin(x[1])
        normal += math.sin(out[1]) * math.cos(out[2]) * math.cos(x[1])
        along = math.cos(out[1]) * math.cos(out[2])
        found[k, 0] = out[0] * out[3]
        found[k, 1] = out[0] * (along * math.cos(pitch) + normal * math.sin(pitch))


@jit
def _times(matrix, vector, found):  # type: ignore[no-untyped-def]
    """A matrix (3, 3) times a vector (3,), into `found`."""
    for i in range(3):
        found[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@jit
def _move(model, x, c, afloat, rate, v):  # type: ignore[no-untyped-def]
    """Velocity through the water [m/s] a period later, in `v`; gives its downward part.

    The hull's equation of motion with its added mass, turned as its rates say, under the twin's own
    law: it stalls, sinks tail first while it is heavy with its nose up, and coasts at the surface,
    which carries it and lets it sink by the depth `rate` alone.
    """
    law, inverse, period = model.law, model.inverse, model.period
    own = law.copy()
    own[K_D0] *= math.exp(c[DRAG])
    own[K_D] *= math.exp(c[INDUCED])
    own[K_ALPHA] *= math.exp(c[LIFT])
    if law[CROSS_FLOW] == law[K_D]:  # as where a file says nothing of it
        own[CROSS_FLOW] = own[K_D]
    pitch = _pitch(x, c)
    down, pushed, m, force, change = np.empty((5, 3))
    down[0], down[1] = -math.sin(pitch), math.cos(pitch) * math.sin(x[1])
    down[2] = math.cos(pitch) * math.cos(x[1])
    _times(inverse, down, pushed)  # by a unit of impulse downward
    yields = down[0] * pushed[0] + down[1] * pushed[1] + down[2] * pushed[2]
    weight = 0.0 if afloat else model.hull[2] * (x[5] + c[BALLAST] + x[6] * c[SQUEEZE])
    steps = math.ceil(period / STEP_S)
    for _ in range(steps):
        _times(model.inertia, v, m)
        f0, f1, f2, _, _, _ = native_wrench(own, 0.0, v[0], v[1], v[2], 0.0, 0.0, 0.0)
        force[0] = f0 + weight * down[0] + m[1] * x[4] - m[2] * x[3]
        force[1] = f1 + weight * down[1] + m[2] * x[2] - m[0] * x[4]
        force[2] = f2 + weight * down[2] + m[0] * x[3] - m[1] * x[2]
        _times(inverse, force, change)
        for i in range(3):
            v[i] += period / steps * change[i]
        sinks = down[0] * v[0] + down[1] * v[1] + down[2] * v[2]
        for i in range(3):
            if afloat:
                v[i] += (rate - sinks) / yields * pushed[i]
            v[i] = min(max(v[i], -FASTEST), FASTEST)
    return down[0] * v[0] + down[1] * v[1] + down[2] * v[2]


@jit
def filtered(model, samples, carried, learned):  # type: ignore[no-untyped-def]
    """Outputs (time, 5) of the samples (time, 11), and at how many it learned; `carried` goes on,
    and the first of those it learned from go into `learned` (n, LEARNED)."""
    hull, period, n, size = model.hull, model.period, samples.shape[0], model.prior.size
    mass, volume, gravity, reference, squeeze = hull[0], hull[1], hull[2], hull[3], hull[4]
    outputs = np.zeros((n, 5))
    x, start, out = np.zeros(7), np.zeros(3), np.zeros(4)
    now, v = np.zeros(7), carried[VELOCITY : VELOCITY + 3]
    slopes, gain = np.zeros(size), np.zeros(size)
    c = carried[GUESS:COVARIANCE]
    cov = carried[COVARIANCE:].reshape((size, size))
    degree = math.pi / 180.0
    corrections = 0
    short = 1.0 - math.exp(-period / SMOOTHED_S)
    prompt = 1.0 - math.exp(-period / PROMPT_S)
    fused = 1.0 - math.exp(-period / FUSED_S)
    quiet = 1.0 - math.exp(-period / QUIET_S)
    for k in range(n):
        s = samples[k]
        first = carried[STARTED] == 0.0
        depth, density = s[DEPTH], s[DENSITY]
        roll, pitch = s[ROLL] * degree, s[PITCH] * degree
        size_f = math.sqrt(s[FX] * s[FX] + s[FY] * s[FY] + s[FZ] * s[FZ])
        shown = math.asin(min(max(s[FX] / size_f, -1.0), 1.0)) if size_f > 0.0 else pitch
        offset = min(max(pitch - shown, -MOST_OFFSET), MOST_OFFSET)
        carried[OFFSET] += (1.0 if first else fused) * (offset - carried[OFFSET])
        pitch -= carried[OFFSET]
        standard = STANDARD_OCEAN[0] + STANDARD_OCEAN[1] * max(depth, 0.0)
        rate = 0.0 if first else (depth - carried[BEFORE]) / period * standard / density
        carried[BEFORE] = depth
        # Net mass and how it changes with compressibility.
        pressure = max(depth, 0.0) * reference * gravity
        hull_volume = volume + CUBIC_CM * s[PUMP]
        net = mass - density * hull_volume * (1.0 - squeeze * pressure)
        given = (pitch, roll, s[P], s[Q], s[R], net, density * hull_volume * pressure, rate)
        for i in range(8):
            carried[MEANS + i] += (1.0 if first else short) * (given[i] - carried[MEANS + i])
        for i in range(7):
            x[i] = carried[MEANS + i]
            now[i] = given[i]
        rate = carried[MEANS + 7]
        carried[RESTLESS] += quiet * (abs(pitch - x[0]) - carried[RESTLESS])
        carried[SLOW_RATE] += quiet * (rate - carried[SLOW_RATE])
        still = depth < SURFACE_DEPTH or (depth < SHALLOW_DEPTH and abs(rate) < RESTING_RATE)
        carried[SINCE_AFLOAT] = 0.0 if still else carried[SINCE_AFLOAT] + period
        carried[SINCE_UPDATE] += period
        carried[STARTED] = 1.0
        # Under way by inputs that do not lag; afloat by prompt means, where these are not noise.
        for i, value in ((PROMPT_PITCH, pitch), (PROMPT_SINKS, given[RATE])):
            carried[i] += (1.0 if first else prompt) * (value - carried[i])
        sinks = carried[PROMPT_SINKS]
        if still:
            now[0] = carried[PROMPT_PITCH]
        if abs(sinks - rate) < PROMPT_RATE:
            sinks = rate
        down = _move(model, now, c, still, sinks, v)
        carried[SUNK] += short * (down - carried[SUNK])
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        alpha = math.atan2(v[2], v[0])
        attached = abs(alpha) < model.law[LINEAR]
        steady = carried[SINCE_AFLOAT] > AFLOAT_S and carried[RESTLESS] < QUIET_PITCH
        steady = steady and abs(rate - carried[SLOW_RATE]) < QUIET_RATE
        steady = steady and abs(down) > LEAST_SINE * speed and rate * down > 0.0
        learning = steady and carried[SINCE_UPDATE] > EVERY_S
        if learning:
            carried[SINCE_UPDATE] = 0.0
            start[:] = 0.0
            if attached:
                start[0], start[1], start[2] = speed, alpha, math.asin(v[1] / speed)
            learning = _balance(model, x, c, start, out)
            if learning and not attached:
                # The depth rate tells a stalled hull from one that is only taken for stalled.
                learning = abs(rate - out[0] * out[3]) < abs(rate - down)
                if learning:
                    v[0] = out[0] * math.cos(out[1]) * math.cos(out[2])
                    v[1] = out[0] * math.sin(out[2])
                    v[2] = out[0] * math.sin(out[1]) * math.cos(out[2])
        if learning:
            if corrections < learned.shape[0]:
                for i in range(7):
                    learned[corrections, i] = x[i]
                learned[corrections, RATE] = rate
                learned[corrections, PLACE] = k
            corrections += 1
            before = c.copy()
            variance = model.rate_variance
            for _ in range(RELINEARISED):
                for i in range(3):
                    start[i] = out[i]
                here = _slopes(model, x, c, start, math.nan, slopes, out)
                variance = model.rate_variance
                for i in range(size):
                    gain[i] = 0.0
                    for j in range(size):
                        gain[i] += cov[i, j] * slopes[j]
                    variance += gain[i] * slopes[i]
                surprise = rate - here
                for j in range(size):
                    surprise -= slopes[j] * (before[j] - c[j])
                for i in range(size):
                    c[i] = before[i] + gain[i] / variance * surprise
            for i in range(size):
                for j in range(size):
                    cov[i, j] -= gain[i] * gain[j] / variance
            for i in range(3):
                start[i] = out[i]
            carried[SPREAD] = _spread(model, x, c, cov, rate, start, slopes, out)
        # The depth rate has the say where the path is steep; afloat it had it.
        flat, sunk = FLAT_SINE * speed, carried[SUNK]
        weight = flat * flat + sunk * sunk
        scale = max((flat * flat + rate * sunk) / weight, 0.0) if weight > 0.0 else 0.0
        scale = 1.0 if still else scale
        outputs[k, 0], outputs[k, 1] = scale * v[0], scale * v[1]
        outputs[k, 2] = min(max(alpha, -WIDEST), WIDEST)
        outputs[k, 3] = 1.0 if steady and attached else 0.0
        outputs[k, 4] = carried[SPREAD] * max(abs(outputs[k, 0]), LEAST_SURGE)
    return outputs, corrections
