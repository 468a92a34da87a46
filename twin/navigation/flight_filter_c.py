"""Flight filter in C99: the filter of `flight_filter_kernels` in float32, without Python.

- The constants are in units of their prior standard deviations. The elements of their covariance
  are then near 1 at the start; in SI units they would span twenty orders of magnitude.
- The covariance is stored as a square root S, P = S S', which rounding cannot make indefinite.
  Potter's formula corrects it (Kaminski, Bryson and Schmidt, "Discrete square root filtering: a
  survey of current techniques", IEEE Transactions on Automatic Control 16, 1971, section III).
- Rounding would spoil small differences of large numbers. So the net mass is computed from the
  density's difference from the reference, the angle between attitude and accelerometers from its
  sine, and slopes of the balance from changes (`gt_pair` of `c_math`).
"""

from __future__ import annotations

import math
import re

import numpy as np

from twin.navigation import flight_filter_kernels as kernels
from twin.navigation.c_math import braced, number
from twin.navigation.dead_reckoning import Array
from twin.navigation.flight_filter import FlightFilter
from twin.vehicle.laws import flow_frame
from twin.water.density import STANDARD_OCEAN

NUMBERS = kernels.CARRIED
"""Number of floats of the filter's state, all 0 before the first sample. The layout is that
of `flight_filter_kernels`; constants and covariance are scaled, and times are in samples."""


def c_flight(*flights: FlightFilter) -> str:
    """C text of `gt_flight(const gt_begin *begin, float *carried, const glider_sample *sample,
    float *estimated)`, which writes the kernels' OUTPUTS of a sample. The filters have one vehicle
    and period; the table `gt_begins` holds the initial values of each."""
    law, inertia, hull, prior, _, period, inverse = flights[0].model
    mass, volume, gravity, reference, _ = map(float, hull)
    names = "VOLUME GRAVITY REFERENCE SQUEEZE OCEAN DEEPER SHALLOW SURFACE"
    sea = (*hull[1:], *STANDARD_OCEAN, kernels.SHALLOW_DEPTH, kernels.SURFACE_DEPTH)
    coefficients = "K_D0 K_D K_L0 K_ALPHA K_BETA K_BETA_LIFT ZERO_LIFT LINEAR"
    means = {"FUSED": "FUSED_S", "BRIEF": "SMOOTHED_S", "PROMPT": "PROMPT_S", "QUIET": "QUIET_S"}
    begins = []
    for flight in flights:
        constants, covariance = flight.begins
        values, vectors = np.linalg.eigh(covariance / np.outer(prior, prior))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        rate = number(flight.model.rate_variance)
        begins.append(f"{{{braced(constants / prior)},\n{braced(root.ravel())},\n{rate}}}")
    steps = math.ceil(period / kernels.STEP_S)
    cross = law[flow_frame.CROSS_FLOW]
    own: dict[str, str | int | float | Array] = {
        "INERTIA": inertia, "INVERSE": inverse, "PRIOR": prior,
        "STEPS": steps, "STEP": period / steps, "PERIOD": period,
        **dict(zip(names.split(), map(float, sea), strict=True)),
        **{name: law[getattr(flow_frame, name)] for name in coefficients.split()},
        **{name: -math.expm1(-period / getattr(kernels, time)) for name, time in means.items()},
        "GROWTH": np.expm1(kernels.NUDGE * prior),
        "BEGINS": "{" + ",\n".join(begins) + "}",
        "CROSS": "induced" if cross == law[flow_frame.K_D] else cross,
        "BLENDS": 1.0 / (law[flow_frame.BLEND] - law[flow_frame.LINEAR]),
        "AFLOAT": float(samples_beyond(kernels.AFLOAT_S, period)),
        "EVERY": float(samples_beyond(kernels.EVERY_S, period)),
        "MOST_SINE": math.sin(kernels.MOST_OFFSET),
        "DEGREE": math.radians(1.0),
        "NEUTRAL": mass - reference * volume,
        "HEAVIER": reference * gravity,
        "FLAT2": kernels.FLAT_SINE**2,
        "HALF_WIDEST": 0.5 * kernels.WIDEST,
    }  # fmt: skip

    def written(name: re.Match[str]) -> str:
        value = own[name[1]] if name[1] in own else getattr(kernels, name[1])
        if isinstance(value, np.ndarray):
            return braced(value.ravel())
        return number(value) if isinstance(value, float) else str(value)

    return re.sub("@(.*?)@", written, _TEXT)


def samples_beyond(seconds: float, period: float) -> int:
    """Smallest number of periods whose running sum, as in the kernels, exceeds `seconds`."""
    count, total = 0, 0.0
    while total <= seconds:
        count, total = count + 1, total + period
    return count


_TEXT = """\
/* Initial values of a filter: constants in prior standard deviations, a root of their covariance,
 * and the variance of a depth rate. */
typedef struct {
    float constants[7], root[49], rate;
} gt_begin;
static const gt_begin gt_begins[] = @BEGINS@;
static const float gt_inertia[] = @INERTIA@;
static const float gt_inverse[] = @INVERSE@; /* inverse of gt_inertia */

/* Steady balance of forces: writes speed, angle of attack, sideslip and downward direction cosine
 * to `out`, each with its change by a small step of constant number `nudged`. Returns 0 if no
 * force acts along the hull. */
static int gt_balance(const float *x, const float *c, int nudged, const float *start,
                      int iterations, gt_pair *out)
{
    static const float prior[] = @PRIOR@;
    static const float growth[] = @GROWTH@;
    gt_pair own[7], drag, induced, slope, sp, cp, ca, sa, cb, sb, net, w[3], v[3], m[3], t[3];
    for (int j = 0; j < 7; j++) {
        own[j].value = c[j] * prior[j];
        own[j].change = j == nudged ? @NUDGE@ * prior[j] : 0.0f;
    }
    drag.value = @K_D0@ * gt_exp(own[0].value);
    induced.value = @K_D@ * gt_exp(own[6].value);
    slope.value = @K_ALPHA@ * gt_exp(own[1].value);
    drag.change = nudged == 0 ? drag.value * growth[0] : 0.0f;
    induced.change = nudged == 6 ? induced.value * growth[6] : 0.0f;
    slope.change = nudged == 1 ? slope.value * growth[1] : 0.0f;
    const gt_pair pitch = {x[0], 0.0f}, still = {x[5], 0.0f}, shift = {-(@K_L0@), 0.0f};
    gt_directed(pitch, &sp, &cp);
    gt_directed(gt_plus(pitch, gt_plus(gt_scaled(-cp.value, own[2]), gt_scaled(-sp.value, own[3]))),
                &sp, &cp);
    net = gt_plus(still, gt_plus(own[4], gt_scaled(x[6], own[5])));
    const float sense = sp.value > 0.0f ? -1.0f : 1.0f;
    if (sense * net.value < @LEAST_NET@) {
        const float grows = sense * net.change / @LEAST_NET@;
        net.value = sense * @LEAST_NET@ * gt_exp(sense * net.value / @LEAST_NET@ - 1.0f);
        net.change = net.value * (gt_exp(grows) - 1.0f);
    }
    net = gt_scaled(@GRAVITY@, net);
    w[0] = gt_scaled(-1.0f, gt_times(net, sp));
    w[1] = gt_scaled(gt_sine(x[1]), gt_times(net, cp));
    w[2] = gt_scaled(gt_cosine(x[1]), gt_times(net, cp));
    gt_pair speed = {start[0], 0.0f}, alpha = {start[1], 0.0f}, beta = {start[2], 0.0f};
    if (fabsf(alpha.value) > @HALF_WIDEST@ || fabsf(beta.value) > @HALF_WIDEST@) {
        speed.value = 0.3f;
        alpha.value = beta.value = 0.0f;
    }
    for (int k = 0;; k++) {
        gt_directed(alpha, &sa, &ca);
        gt_directed(beta, &sb, &cb);
        v[0] = gt_times(ca, cb);
        v[1] = sb;
        v[2] = gt_times(sa, cb);
        if (k == iterations)
            break;
        for (int i = 0; i < 3; i++)
            m[i] = gt_times(speed, gt_plus(gt_scaled(gt_inertia[3 * i], v[0]),
                gt_plus(gt_scaled(gt_inertia[3 * i + 1], v[1]),
                    gt_scaled(gt_inertia[3 * i + 2], v[2]))));
        for (int i = 0; i < 3; i++) {
            const int next = (i + 1) % 3, last = (i + 2) % 3;
            t[i] = gt_plus(w[i], gt_plus(gt_scaled(x[2 + last], m[next]),
                gt_scaled(-x[2 + next], m[last])));
        }
        const gt_pair along = gt_dot(v, t);
        const gt_pair side = gt_plus(gt_times(cb, t[1]), gt_scaled(-1.0f,
            gt_times(sb, gt_plus(gt_times(ca, t[0]), gt_times(sa, t[2])))));
        const gt_pair normal = gt_plus(gt_times(ca, t[2]), gt_scaled(-1.0f, gt_times(sa, t[0])));
        if (along.value <= 1e-6f)
            return 0;
        const gt_pair lifting = gt_times(induced, gt_times(alpha, alpha));
        const gt_pair square = gt_over(along, gt_plus(drag, lifting));
        alpha = gt_held(gt_over(gt_plus(gt_over(normal, square), shift), slope), @WIDEST@);
        beta = gt_held(gt_scaled(-1.0f / @K_BETA@, gt_over(side, square)), @WIDEST@);
        speed.value = sqrtf(square.value);
        speed.change = square.change / (speed.value + sqrtf(square.value + square.change));
    }
    out[0] = speed;
    out[1] = alpha;
    out[2] = beta;
    const gt_pair level = gt_plus(gt_scaled(gt_sine(x[1]), v[1]), gt_scaled(gt_cosine(x[1]), v[2]));
    out[3] = gt_plus(gt_times(cp, level), gt_scaled(-1.0f, gt_times(sp, v[0])));
    return 1;
}

/* Surge of a balance; on steep paths the depth rate determines the speed. */
static gt_pair gt_surge(const gt_pair *out, float rate)
{
    gt_pair sine, ca, cb, weight = gt_times(out[3], out[3]);
    weight.value += @FLAT2@;
    gt_pair speed = gt_over(gt_plus(gt_scaled(@FLAT2@, out[0]), gt_scaled(rate, out[3])), weight);
    if (!(speed.value > 0.0f))
        speed.value = speed.change = 0.0f;
    gt_directed(out[1], &sine, &ca);
    gt_directed(out[2], &sine, &cb);
    return gt_times(speed, gt_times(ca, cb));
}

/* Returns the depth rate of the balance, or its surge if `rate` is given, and writes the derivative
 * by each constant to `slope`. `out` holds the speed and angles to start from, then the balance. */
static float gt_slopes(const float *x, const float *c, const float *rate, float *slope,
                       gt_pair *out)
{
    const float start[3] = {out[0].value, out[1].value, out[2].value};
    gt_pair found = {0.0f, 0.0f};
    for (int j = 0; j < 7; j++) {
        gt_balance(x, c, j, start, @ITERATIONS@, out);
        found = rate ? gt_surge(out, *rate) : gt_times(out[0], out[3]);
        slope[j] = found.change / @NUDGE@;
    }
    return found.value;
}

/* Writes the transposed root of the covariance times a slope; returns the variance along it. */
static float gt_along(const float *root, const float *slope, float *through)
{
    float variance = 0.0f;
    for (int j = 0; j < 7; j++) {
        through[j] = 0.0f;
        for (int i = 0; i < 7; i++)
            through[j] += root[7 * i + j] * slope[i];
        variance += through[j] * through[j];
    }
    return variance;
}

/* Corrects the seven constants by the depth rate; returns the relative standard deviation of surge
 * by their remaining uncertainty. */
static float gt_correct(float *c, float *root, const float *x, float rate, float noise,
                        gt_pair *out)
{
    float before[7], slope[7], through[7], gain[7], variance = noise;
    memcpy(before, c, sizeof before);
    for (int again = 0; again < @RELINEARISED@; again++) {
        float surprise = rate - gt_slopes(x, c, NULL, slope, out);
        variance = noise + gt_along(root, slope, through);
        for (int i = 0; i < 7; i++) {
            gain[i] = gt_sum(root + 7 * i, through, 7);
            surprise -= slope[i] * (before[i] - c[i]);
        }
        for (int i = 0; i < 7; i++)
            c[i] = before[i] + gain[i] / variance * surprise;
    }
    const float less = 1.0f / (variance + sqrtf(variance * noise));
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            root[7 * i + j] -= less * gain[i] * through[j];
    const float surge = gt_slopes(x, c, &rate, slope, out);
    return sqrtf(gt_along(root, slope, through)) / gt_most(surge, @LEAST_SURGE@);
}

/* Multiplies a matrix (3, 3) by a vector. */
static void gt_mapped(const float *matrix, const float *v, float *made)
{
    for (int i = 0; i < 3; i++)
        made[i] = gt_sum(matrix + 3 * i, v, 3);
}

/* Weight, at a flow angle, of the law for all angles; 0 at small angles. */
static float gt_blend(float angle)
{
    const float x = (fabsf(angle) - @LINEAR@) * @BLENDS@;
    return x > 0.0f ? x < 1.0f ? x * x * (3.0f - 2.0f * x) : 1.0f : 0.0f;
}

/* Force of the water [N] on a hull with these coefficients at velocity `v` through the water;
 * returns the angle of attack [rad]. */
static float gt_force(float drag, float induced, float slope, const float *v, float *force)
{
    const float square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], speed = sqrtf(square);
    const float plane = sqrtf(v[0] * v[0] + v[2] * v[2]);
    float ca = 1.0f, sa = 0.0f, cb = 1.0f, sb = 0.0f;
    if (plane > 1e-12f) {
        ca = v[0] / plane;
        sa = v[2] / plane;
    }
    if (speed > 1e-9f) {
        cb = plane / speed;
        sb = v[1] / speed;
    }
    const float alpha = gt_angle(sa, ca), beta = gt_arcsine(sb);
    const float s = gt_most(gt_blend(alpha), gt_blend(beta)), k = 1.0f - s;
    const float fx = ca * cb, fz = sa * cb;
    const float back = square * (drag + k * induced * alpha * alpha
        + s * @CROSS@ * (sb * sb + fz * fz));
    const float side = square * (k * (@K_BETA@ + @K_BETA_LIFT@ * (alpha + @ZERO_LIFT@)) * beta
        + s * @K_BETA@ * sb * cb);
    const float lift = square * (k * (@K_L0@ + slope * alpha) + s * (@K_L0@ + slope * fz) * fx);
    force[0] = sa * lift - fx * back - ca * sb * side;
    force[1] = cb * side - sb * back;
    force[2] = -fz * back - sa * sb * side - ca * lift;
    return alpha;
}

/* Advances the velocity through the water [m/s] by one period; returns its downward component. At
 * the surface the water supports the hull, and the depth rate is the downward velocity. */
static float gt_move(float *v, const float *x, const float *c, int afloat, float rate)
{
    static const float prior[] = @PRIOR@;
    const float drag = @K_D0@ * gt_exp(c[0] * prior[0]);
    const float induced = @K_D@ * gt_exp(c[6] * prior[6]);
    const float slope = @K_ALPHA@ * gt_exp(c[1] * prior[1]);
    float down[3], pushed[3], m[3], force[3], change[3], sine, cosine;
    gt_direction(x[0], &sine, &cosine);
    gt_direction(x[0] - c[2] * prior[2] * cosine - c[3] * prior[3] * sine, &sine, &cosine);
    down[0] = -sine;
    gt_direction(x[1], down + 1, down + 2);
    down[1] *= cosine;
    down[2] *= cosine;
    gt_mapped(gt_inverse, down, pushed);
    const float yields = gt_sum(down, pushed, 3);
    const float weight = afloat ? 0.0f
        : @GRAVITY@ * (x[5] + c[4] * prior[4] + x[6] * (c[5] * prior[5]));
    for (int step = 0; step < @STEPS@; step++) {
        gt_mapped(gt_inertia, v, m);
        gt_force(drag, induced, slope, v, force);
        for (int i = 0; i < 3; i++) {
            const int next = (i + 1) % 3, last = (i + 2) % 3;
            force[i] += weight * down[i] + m[next] * x[2 + last] - m[last] * x[2 + next];
        }
        gt_mapped(gt_inverse, force, change);
        for (int i = 0; i < 3; i++)
            v[i] += @STEP@ * change[i];
        const float push = afloat ? (rate - gt_sum(down, v, 3)) / yields : 0.0f;
        for (int i = 0; i < 3; i++)
            v[i] = gt_bounded(v[i] + push * pushed[i], @FASTEST@);
    }
    return gt_sum(down, v, 3);
}

/* Writes surge and sway [m/s], angle of attack [rad], 1 if the glide is steady, and the standard
 * deviation of surge [m/s]; steady glides correct the constants of the balance of forces. */
static void gt_flight(const gt_begin *begin, float *carried, const glider_sample *sample,
                      float *estimated)
{
    const int first = carried[@STARTED@] == 0.0f;
    float *c = carried + @GUESS@, *root = carried + @COVARIANCE@;
    if (first) {
        memcpy(c, begin->constants, sizeof begin->constants);
        memcpy(root, begin->root, sizeof begin->root);
    }
    const float depth = sample->measured_depth, density = sample->measured_density;
    const float fx = sample->measured_specific_force_x, fy = sample->measured_specific_force_y;
    const float fz = sample->measured_specific_force_z;
    const float attitude = sample->measured_pitch * @DEGREE@;
    const float across = sqrtf(fy * fy + fz * fz), size = sqrtf(fx * fx + across * across);
    float sine, cosine, offset = 0.0f;
    gt_direction(attitude, &sine, &cosine);
    if (size > 0.0f) {
        const float off = (sine * across - cosine * fx) / size; /* sine of the difference */
        const int small = fabsf(off) < @MOST_SINE@ && cosine * across + sine * fx > 0.0f;
        offset = small ? off + off * off * off / 6.0f : off > 0.0f ? @MOST_OFFSET@ : -@MOST_OFFSET@;
    }
    const float brief = first ? 1.0f : @BRIEF@;
    carried[@OFFSET@] += (first ? 1.0f : @FUSED@) * (offset - carried[@OFFSET@]);
    const float pitch = attitude - carried[@OFFSET@];
    const float below = gt_most(depth, 0.0f);
    const float change = first ? 0.0f
        : (depth - carried[@BEFORE@]) / @PERIOD@ * (@OCEAN@ + @DEEPER@ * below) / density;
    carried[@BEFORE@] = depth;
    const float pressure = below * @HEAVIER@;
    const float pumped = @CUBIC_CM@ * sample->measured_pump;
    const float displaced = density * (@VOLUME@ + pumped);
    float given[8] = {
        pitch, sample->measured_roll * @DEGREE@, sample->measured_roll_rate,
        sample->measured_pitch_rate, sample->measured_yaw_rate,
        @NEUTRAL@ - (density - @REFERENCE@) * @VOLUME@ - density * pumped
            + displaced * (@SQUEEZE@ * pressure),
        displaced * pressure, change};
    float *x = carried + @MEANS@;
    for (int i = 0; i < 8; i++)
        x[i] += brief * (given[i] - x[i]);
    const float rate = x[7];
    carried[@RESTLESS@] += @QUIET@ * (fabsf(pitch - x[0]) - carried[@RESTLESS@]);
    carried[@SLOW_RATE@] += @QUIET@ * (rate - carried[@SLOW_RATE@]);
    const int still = depth < @SURFACE@ || (depth < @SHALLOW@ && fabsf(rate) < @RESTING_RATE@);
    carried[@SINCE_AFLOAT@] = still ? 0.0f : carried[@SINCE_AFLOAT@] + 1.0f;
    carried[@SINCE_UPDATE@] += 1.0f;
    carried[@STARTED@] = 1.0f;
    /* under water, inputs without lag; afloat, the prompt means if they exceed the noise */
    const float prompt = first ? 1.0f : @PROMPT@;
    carried[@PROMPT_PITCH@] += prompt * (pitch - carried[@PROMPT_PITCH@]);
    carried[@PROMPT_SINKS@] += prompt * (change - carried[@PROMPT_SINKS@]);
    if (still)
        given[0] = carried[@PROMPT_PITCH@];
    const int noise = fabsf(carried[@PROMPT_SINKS@] - rate) < @PROMPT_RATE@;
    float *v = carried + @VELOCITY@, start[3] = {0.0f, 0.0f, 0.0f};
    const float down = gt_move(v, given, c, still, noise ? rate : carried[@PROMPT_SINKS@]);
    carried[@SUNK@] += @BRIEF@ * (down - carried[@SUNK@]);
    const float square = gt_sum(v, v, 3), speed = sqrtf(square);
    const float plane = sqrtf(v[0] * v[0] + v[2] * v[2]);
    const float alpha = plane > 1e-12f ? gt_angle(v[2] / plane, v[0] / plane) : 0.0f;
    const int attached = fabsf(alpha) < @LINEAR@;
    const int steady = carried[@SINCE_AFLOAT@] >= @AFLOAT@ && carried[@RESTLESS@] < @QUIET_PITCH@
        && fabsf(rate - carried[@SLOW_RATE@]) < @QUIET_RATE@
        && fabsf(down) > @LEAST_SINE@ * speed && rate * down > 0.0f;
    if (steady && carried[@SINCE_UPDATE@] >= @EVERY@) {
        gt_pair out[4];
        carried[@SINCE_UPDATE@] = 0.0f;
        if (attached) {
            start[0] = speed;
            start[1] = alpha;
            start[2] = gt_arcsine(v[1] / speed);
        }
        int learning = gt_balance(x, c, -1, start, @ITERATIONS@, out);
        if (learning && !attached) {
            /* the depth rate shows whether the hull stalls, or the velocity here is wrong */
            learning = fabsf(rate - out[0].value * out[3].value) < fabsf(rate - down);
            if (learning) {
                gt_direction(out[2].value, &sine, &cosine);
                v[1] = out[0].value * sine;
                gt_direction(out[1].value, v + 2, v);
                v[0] *= out[0].value * cosine;
                v[2] *= out[0].value * cosine;
            }
        }
        if (learning)
            carried[@SPREAD@] = gt_correct(c, root, x, rate, begin->rate, out);
    }
    const float flat = @FLAT2@ * square, sunk = carried[@SUNK@], weight = flat + sunk * sunk;
    const float scale = still ? 1.0f
        : weight > 0.0f ? gt_most((flat + rate * sunk) / weight, 0.0f) : 0.0f;
    estimated[0] = scale * v[0];
    estimated[1] = scale * v[1];
    estimated[2] = gt_bounded(alpha, @WIDEST@);
    estimated[3] = (float)(steady && attached);
    estimated[4] = carried[@SPREAD@] * gt_most(fabsf(estimated[0]), @LEAST_SURGE@);
}
"""
