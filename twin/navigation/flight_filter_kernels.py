"""Flight filter kernels: compiled code that filters one sample after the other.

`samples` hold CHANNELS; `carried` holds the filter's state. The constants below name the places
in both."""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import jit
from twin.navigation.dead_reckoning import RESTING_RATE, SHALLOW_DEPTH, SURFACE_DEPTH
from twin.vehicle.laws.flow_frame import CROSS_FLOW, K_ALPHA, K_D, K_D0, LINEAR, native_wrench
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.steady_motion import balanced_forces
from twin.water.density import STANDARD_OCEAN

CHANNELS = (
    *("measured_depth", "measured_roll", "measured_pitch"),
    *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate"),
    *("measured_specific_force_x", "measured_specific_force_y", "measured_specific_force_z"),
    *("measured_pump", "measured_density"),
)
"""Channels of a sample, in order."""
DEPTH, ROLL, PITCH, P, Q, R, FX, FY, FZ, PUMP, DENSITY = range(len(CHANNELS))
CONSTANTS = ("drag", "lift_slope", "pitch_x", "pitch_z", "ballast", "compressibility", "induced")
DRAG, LIFT, TILT_X, TILT_Z, BALLAST, SQUEEZE, INDUCED = range(len(CONSTANTS))
OUTPUTS = ("surge", "sway", "attack", "steady", "surge_sd")
"""Outputs for each sample: surge and sway [m/s], the angle of attack [rad], 1 in a steady
glide, and surge's standard deviation [m/s] from the uncertainty of the constants. The angle is
limited to +-0.3 rad: stalled or tail first, only its sign is meaningful."""
SMOOTHED_S = 5.0
"""[s] Time constant of the balance's exponential means: longer than noise, shorter than a glider
takes to settle."""
PROMPT_S = 1.0
"""[s] Time constant of the means of pitch and depth rate afloat. A surfacing hull turns by 100
degrees in ten seconds: both means must have the same small lag."""
PROMPT_RATE = 0.02
"""[m/s] Smallest difference of the depth rate's means over PROMPT_S and SMOOTHED_S for the first to
be used. A smaller difference is noise, which would propel a hull with wings forward."""
FUSED_S = 20.0
"""[s] Time constant with which the attitude's pitch follows the accelerometers'."""
QUIET_S = 10.0
"""[s] Time constant of the test for a steady glide."""
QUIET_PITCH = math.radians(1.0)
"""[rad] Largest mean difference of pitch from its mean in a steady glide."""
QUIET_RATE = 0.01
"""[m/s] Largest difference of the depth rate from its slow mean in a steady glide."""
AFLOAT_S = 40.0
"""[s] Time without corrections after a surface interval."""
EVERY_S = 15.0
"""[s] Time between corrections, about the correlation time of a glider's errors."""
ITERATIONS = 12
"""Fixed-point iterations of a balance."""
STEP_S = 0.125
"""[s] Longest step of the motion: a hull reaches its angle of attack in half a second or more."""
FASTEST = 3.0
"""[m/s] Limit of the velocity along each axis of the hull; beyond, a channel is wrong."""
RELINEARISED = 2
"""Number of linearisations of a correction, each about the constants of the previous one."""
NUDGE = 0.1
"""[1] Step of the finite differences, in prior standard deviations."""
FLAT_SINE = 0.07
"""Sine of the glide angle at which the speeds by buoyancy and depth rate weigh equally, as in
`steady_flight`."""
LEAST_SINE = 0.12
"""Smallest sine of the glide angle for a correction"""
LEAST_SURGE = 0.05
"""[m/s] Surge below which its standard deviation is absolute, not relative"""
LEAST_NET = 0.05
"""[kg] Net buoyancy below which an exponential replaces it. The result stays positive even for
buoyancy of the wrong sign, so that the ballast is still estimated."""
WIDEST = 0.3
"""[rad] Limit of the flow angles; beyond half of it, the iteration restarts from zero angles."""
MOST_OFFSET = 0.02
"""[rad] Limit of attitude minus accelerometer pitch; beyond, it is an acceleration."""

STARTED, BEFORE, OFFSET = 0, 1, 2
MEANS = 3
"""First place of the means: pitch, roll, three rates, net mass, its derivative by compressibility,
and depth rate"""
RESTLESS, SLOW_RATE, SINCE_AFLOAT, SINCE_UPDATE = 11, 12, 13, 14
VELOCITY, SUNK = 15, 18
"""Places. VELOCITY: [m/s] of the motion, along the hull's axes. SUNK: its mean downward velocity"""
SPREAD = 19
"""Place of surge's relative standard deviation from the constants, updated at each correction"""
PROMPT_PITCH, PROMPT_SINKS = 20, 21
"""Places of means over PROMPT_S. PROMPT_PITCH: of pitch. PROMPT_SINKS: of the depth rate"""
GUESS = 22
COVARIANCE = GUESS + len(CONSTANTS)
CARRIED = COVARIANCE + len(CONSTANTS) ** 2
RATE, PLACE, LEARNED = 7, 8, 9
"""Glide's columns after its means. RATE: [m/s] depth rate. PLACE: sample. LEARNED: their number"""


@jit
def _pitch(x, c):  # type: ignore[no-untyped-def]
    """Pitch [rad] corrected for the accelerometers' errors."""
    return x[0] - (c[TILT_X] * math.cos(x[0]) + c[TILT_Z] * math.sin(x[0]))


@jit
def _balance(model, x, c, start, out):  # type: ignore[no-untyped-def]
    """Solve the balance: speed, angle of attack, sideslip, downward direction cosine, in `out`.

    `model` is a `FlightFilterModel` in all functions here. `x` are pitch, roll, three rates, net
    mass and its derivative by compressibility; `c` the constants; `start` the initial speed and
    angles. Returns False if no force acts along the hull.
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
def _surge_or_rate(out, rate):  # type: ignore[no-untyped-def]
    """Surge [m/s] of a balance; on steep paths the measured depth `rate` determines the speed. If
    `rate` is NaN, the result is the depth rate [m/s] of the balance."""
    if rate != rate:
        return out[0] * out[3]
    speed = (out[0] * FLAT_SINE**2 + rate * out[3]) / (FLAT_SINE**2 + out[3] * out[3])
    return max(speed, 0.0) * math.cos(out[1]) * math.cos(out[2])


@jit
def _slopes(model, x, c, start, rate, found, out):  # type: ignore[no-untyped-def]
    """Value of `_surge_or_rate`; writes its derivatives by the constants to `found`, (7,), and the
    balance of `c` to `out`."""
    for j in range(c.size):
        kept, nudge = c[j], NUDGE * model.prior[j]
        c[j] += nudge
        _balance(model, x, c, start, out)
        found[j] = _surge_or_rate(out, rate) / nudge
        c[j] = kept
    _balance(model, x, c, start, out)
    here = _surge_or_rate(out, rate)
    for j in range(c.size):
        found[j] -= here / (NUDGE * model.prior[j])
    return here


@jit
def _surge_deviation(model, x, c, cov, rate, start, slopes, out):  # type: ignore[no-untyped-def]
    """Relative standard deviation of surge from the constants' uncertainty."""
    surge, variance = _slopes(model, x, c, start, rate, slopes, out), 0.0
    for i in range(c.size):
        for j in range(c.size):
            variance += slopes[i] * cov[i, j] * slopes[j]
    return math.sqrt(max(variance, 0.0)) / max(surge, LEAST_SURGE)


@jit
def balanced(model, glides, c, found):  # type: ignore[no-untyped-def]
    """Depth rate and level forward speed [m/s] of steady glides (n, LEARNED), in `found`, (n, 2);
    NaN if no force acts along the hull."""
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
    """Multiply a matrix (3, 3) by a vector (3,), into `found`."""
    for i in range(3):
        found[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@jit
def _move(model, x, c, afloat, rate, v):  # type: ignore[no-untyped-def]
    """Advance the velocity `v` through the water [m/s] by a period; return its downward part.

    The equation of motion has added mass, the measured turn rates and the twin's own law. The hull
    can stall, sink tail first if it is heavy with its nose up, and coast at the surface. At the
    surface the water supports the hull, and the depth `rate` is its downward velocity.
    """
    law, inverse, period = model.law, model.inverse, model.period
    own = law.copy()
    own[K_D0] *= math.exp(c[DRAG])
    own[K_D] *= math.exp(c[INDUCED])
    own[K_ALPHA] *= math.exp(c[LIFT])
    if law[CROSS_FLOW] == law[K_D]:  # the value if the vehicle's file has no cross flow
        own[CROSS_FLOW] = own[K_D]
    pitch = _pitch(x, c)
    down, pushed, m, force, change = np.empty((5, 3))
    down[0], down[1] = -math.sin(pitch), math.cos(pitch) * math.sin(x[1])
    down[2] = math.cos(pitch) * math.cos(x[1])
    _times(inverse, down, pushed)  # velocity by a unit of impulse downward
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
    """Filter samples (time, 11): outputs (time, 5), and the number of corrections. `carried` is
    updated in place; the first glides used are written to `learned` (n, LEARNED)."""
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
        # Net mass and its derivative by compressibility.
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
        # Under water, inputs without lag; afloat, prompt means if they exceed the noise.
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
                # The depth rate separates a stalled hull from one that only the model has stalled.
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
            carried[SPREAD] = _surge_deviation(model, x, c, cov, rate, start, slopes, out)
        # The depth rate determines the speed on steep paths; afloat, `_move` has used it already.
        flat, sunk = FLAT_SINE * speed, carried[SUNK]
        weight = flat * flat + sunk * sunk
        scale = max((flat * flat + rate * sunk) / weight, 0.0) if weight > 0.0 else 0.0
        scale = 1.0 if still else scale
        outputs[k, 0], outputs[k, 1] = scale * v[0], scale * v[1]
        outputs[k, 2] = min(max(alpha, -WIDEST), WIDEST)
        outputs[k, 3] = 1.0 if steady and attached else 0.0
        outputs[k, 4] = carried[SPREAD] * max(abs(outputs[k, 0]), LEAST_SURGE)
    return outputs, corrections
