"""The flight filter in C99, for vehicles without Python: the code of `flight_filter_kernels`."""

from __future__ import annotations

from collections.abc import Iterable

from twin.navigation.estimators.baseline import RESTING_RATE, SHALLOW_DEPTH, SURFACE_DEPTH
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import (
    AFLOAT_S,
    BEFORE,
    CARRIED,
    COVARIANCE,
    EVERY_S,
    FLAT_SINE,
    FUSED_S,
    GUESS,
    ITERATIONS,
    LEAST_NET,
    LEAST_SINE,
    LEAST_SURGE,
    MEANS,
    MOST_OFFSET,
    NUDGE,
    OFFSET,
    QUIET_PITCH,
    QUIET_RATE,
    QUIET_S,
    RELINEARISED,
    RESTLESS,
    SETTLED,
    SINCE_AFLOAT,
    SINCE_UPDATE,
    SLOW_RATE,
    SMOOTHED_S,
    SPREAD,
    STANDARD_OCEAN,
    STARTED,
    WARM,
    WIDEST,
)
from twin.vehicle.parts.pump import CUBIC_CM

NUMBERS = CARRIED
"""Doubles of the filter's state, zero before the first sample."""


def c_flight(*flights: FlightFilter) -> str:
    """`gt_flight(const gt_begin *begin, double *carried, const glider_sample *sample, double
    *estimated)`: OUTPUTS of a sample, for the filters' one vehicle and period; `gt_begins` has
    what each of them begins with."""
    law, inertia, hull, prior, _, period = flights[0].model
    begins = ",\n    ".join(
        f"{{{_row(flight.begins[0])},\n     {_row(flight.begins[1].ravel())},\n"
        f"     {float(flight.model.rate_variance)!r}}}"
        for flight in flights
    )
    numbers = {
        "LAW": _row(law),
        "INERTIA": _row(inertia.ravel()),
        "PRIOR": _row(prior),
        "BEGINS": f"{{{begins}}}",
        "MASS": repr(float(hull[0])),
        "VOLUME": repr(float(hull[1])),
        "GRAVITY": repr(float(hull[2])),
        "REFERENCE": repr(float(hull[3])),
        "SQUEEZE": repr(float(hull[4])),
        "PERIOD": repr(float(period)),
        "OCEAN": repr(STANDARD_OCEAN[0]),
        "DEEPER": repr(STANDARD_OCEAN[1]),
        **{name: repr(value) for name, value in _SETTINGS.items()},
    }
    text = _TEXT
    for name, value in numbers.items():
        text = text.replace(f"@{name}@", value)
    assert "@" not in text
    return text


def _row(values: Iterable[float]) -> str:
    return "{" + ", ".join(repr(float(v)) for v in values) + "}"


_SETTINGS: dict[str, float | int] = {
    "AFLOAT_S": AFLOAT_S, "BEFORE": BEFORE, "COVARIANCE": COVARIANCE, "CUBIC_CM": CUBIC_CM,
    "EVERY_S": EVERY_S, "FLAT2": FLAT_SINE**2, "FUSED_S": FUSED_S, "GUESS": GUESS,
    "ITERATIONS": ITERATIONS, "LEAST_NET": LEAST_NET, "LEAST_SINE": LEAST_SINE,
    "LEAST_SURGE": LEAST_SURGE, "MEANS": MEANS,
    "MOST_OFFSET": MOST_OFFSET, "NUDGE": NUDGE, "OFFSET": OFFSET, "QUIET_PITCH": QUIET_PITCH,
    "QUIET_RATE": QUIET_RATE, "QUIET_S": QUIET_S, "RELINEARISED": RELINEARISED,
    "RESTING_RATE": RESTING_RATE, "RESTLESS": RESTLESS, "SETTLED": SETTLED,
    "SHALLOW": SHALLOW_DEPTH, "SINCE_AFLOAT": SINCE_AFLOAT, "SINCE_UPDATE": SINCE_UPDATE,
    "SLOW_RATE": SLOW_RATE, "SMOOTHED_S": SMOOTHED_S, "SPREAD": SPREAD, "STARTED": STARTED,
    "SURFACE": SURFACE_DEPTH, "WARM": WARM, "WIDEST": WIDEST, "HALF_WIDEST": 0.5 * WIDEST,
}  # fmt: skip

_TEXT = """\
/* What a filter begins with: constants, their covariance, and the variance of a depth rate. */
typedef struct {
    double constants[7], covariance[49], rate;
} gt_begin;
static const gt_begin gt_begins[] = @BEGINS@;

/* Steady balance of forces: speed, angle of attack, sideslip and the downward part of the
 * direction into `out`; 0 where nothing pulls along the hull. */
static int gt_balance(const double *x, const double *c, const double *start, int iterations,
                      double *out)
{
    static const double law[] = @LAW@;
    static const double inertia[] = @INERTIA@;
    const double drag = law[0] * exp(c[0]), induced = law[1] * exp(c[6]);
    const double slope = law[3] * exp(c[1]);
    const double pitch = x[0] - (c[2] * cos(x[0]) + c[3] * sin(x[0]));
    const double sp = sin(pitch), cp = cos(pitch), sr = sin(x[1]), cr = cos(x[1]);
    double net = x[5] + c[4] + x[6] * c[5];
    if (net * sp > -@LEAST_NET@ * fabs(sp))
        net = sp > 0.0 ? -@LEAST_NET@ : @LEAST_NET@;
    const double weight = @GRAVITY@ * net;
    const double w0 = -weight * sp, w1 = weight * cp * sr, w2 = weight * cp * cr;
    double speed = start[0], alpha = start[1], beta = start[2];
    if (fabs(alpha) > @HALF_WIDEST@ || fabs(beta) > @HALF_WIDEST@) {
        speed = 0.3;
        alpha = beta = 0.0;
    }
    for (int k = 0; k < iterations; k++) {
        const double ca = cos(alpha), sa = sin(alpha), cb = cos(beta), sb = sin(beta);
        const double u = speed * ca * cb, v = speed * sb, w = speed * sa * cb;
        const double m0 = inertia[0] * u + inertia[1] * v + inertia[2] * w;
        const double m1 = inertia[3] * u + inertia[4] * v + inertia[5] * w;
        const double m2 = inertia[6] * u + inertia[7] * v + inertia[8] * w;
        const double t0 = w0 + m1 * x[4] - m2 * x[3];
        const double t1 = w1 + m2 * x[2] - m0 * x[4];
        const double t2 = w2 + m0 * x[3] - m1 * x[2];
        const double along = ca * cb * t0 + sb * t1 + sa * cb * t2;
        const double side = -ca * sb * t0 + cb * t1 - sa * sb * t2;
        const double normal = -sa * t0 + ca * t2;
        if (along <= 1e-6)
            return 0;
        const double square = along / (drag + induced * alpha * alpha);
        alpha = fmin(fmax((normal / square - law[2]) / slope, -@WIDEST@), @WIDEST@);
        beta = fmin(fmax(-side / square / law[4], -@WIDEST@), @WIDEST@);
        speed = sqrt(square);
    }
    out[0] = speed;
    out[1] = alpha;
    out[2] = beta;
    out[3] = -cos(alpha) * cos(beta) * sp + sin(beta) * cp * sr + sin(alpha) * cos(beta) * cp * cr;
    return 1;
}

/* Surge of a balance; the depth rate has the say where the path is steep. */
static double gt_surge(const double *out, double rate)
{
    const double weight = @FLAT2@ + out[3] * out[3];
    const double speed = fmax((out[0] * @FLAT2@ + rate * out[3]) / weight, 0.0);
    return speed * cos(out[1]) * cos(out[2]);
}

/* A correction of the seven constants by the depth rate; gives the deviation of surge over surge
 * that they leave. */
static double gt_correct(double *c, double *cov, const double *x, double rate, double noise,
                         double *out)
{
    static const double prior[] = @PRIOR@;
    double before[7], slope[7], gain[7], start[3], variance = noise;
    memcpy(before, c, sizeof before);
    for (int again = 0; again < @RELINEARISED@; again++) {
        memcpy(start, out, sizeof start);
        for (int j = 0; j < 7; j++) {
            const double kept = c[j], nudge = @NUDGE@ * prior[j];
            c[j] += nudge;
            gt_balance(x, c, start, @ITERATIONS@, out);
            slope[j] = out[0] * out[3] / nudge;
            c[j] = kept;
        }
        gt_balance(x, c, start, @ITERATIONS@, out);
        const double here = out[0] * out[3];
        double surprise = rate - here;
        variance = noise;
        for (int j = 0; j < 7; j++)
            slope[j] -= here / (@NUDGE@ * prior[j]);
        for (int i = 0; i < 7; i++) {
            gain[i] = 0.0;
            for (int j = 0; j < 7; j++)
                gain[i] += cov[7 * i + j] * slope[j];
            variance += gain[i] * slope[i];
            surprise -= slope[i] * (before[i] - c[i]);
        }
        for (int i = 0; i < 7; i++)
            c[i] = before[i] + gain[i] / variance * surprise;
    }
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            cov[7 * i + j] -= gain[i] * gain[j] / variance;
    memcpy(start, out, sizeof start);
    for (int j = 0; j < 7; j++) {
        const double kept = c[j], nudge = @NUDGE@ * prior[j];
        c[j] += nudge;
        gt_balance(x, c, start, @ITERATIONS@, out);
        slope[j] = gt_surge(out, rate) / nudge;
        c[j] = kept;
    }
    gt_balance(x, c, start, @ITERATIONS@, out);
    const double surge = gt_surge(out, rate);
    double spread = 0.0;
    for (int j = 0; j < 7; j++)
        slope[j] -= surge / (@NUDGE@ * prior[j]);
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            spread += slope[i] * cov[7 * i + j] * slope[j];
    return sqrt(fmax(spread, 0.0)) / fmax(surge, @LEAST_SURGE@);
}

/* Surge and sway [m/s], angle of attack [rad], whether the glide is steady, and the deviation of
 * surge [m/s], by a balance of forces that is learned on the way. */
static void gt_flight(const gt_begin *begin, double *carried, const glider_sample *sample,
                      double *estimated)
{
    const double degree = 3.14159265358979323846 / 180.0;
    const int first = carried[@STARTED@] == 0.0;
    double *c = carried + @GUESS@, *cov = carried + @COVARIANCE@;
    if (first) {
        memcpy(c, begin->constants, sizeof begin->constants);
        memcpy(cov, begin->covariance, sizeof begin->covariance);
    }
    const double depth = sample->measured_depth, density = sample->measured_density;
    const double fx = sample->measured_specific_force_x, fy = sample->measured_specific_force_y;
    const double fz = sample->measured_specific_force_z;
    double pitch = sample->measured_pitch * degree;
    const double size = sqrt(fx * fx + fy * fy + fz * fz);
    const double shown = size > 0.0 ? asin(fmin(fmax(fx / size, -1.0), 1.0)) : pitch;
    const double offset = fmin(fmax(pitch - shown, -@MOST_OFFSET@), @MOST_OFFSET@);
    const double fused = first ? 1.0 : 1.0 - exp(-@PERIOD@ / @FUSED_S@);
    const double brief = first ? 1.0 : 1.0 - exp(-@PERIOD@ / @SMOOTHED_S@);
    const double quiet = 1.0 - exp(-@PERIOD@ / @QUIET_S@);
    carried[@OFFSET@] += fused * (offset - carried[@OFFSET@]);
    pitch -= carried[@OFFSET@];
    const double below = fmax(depth, 0.0), standard = @OCEAN@ + @DEEPER@ * below;
    const double change = first ? 0.0
        : (depth - carried[@BEFORE@]) / @PERIOD@ * standard / density;
    carried[@BEFORE@] = depth;
    const double pressure = below * @REFERENCE@ * @GRAVITY@;
    const double volume = @VOLUME@ + @CUBIC_CM@ * sample->measured_pump;
    const double given[8] = {
        pitch, sample->measured_roll * degree, sample->measured_roll_rate,
        sample->measured_pitch_rate, sample->measured_yaw_rate,
        @MASS@ - density * volume * (1.0 - @SQUEEZE@ * pressure), density * volume * pressure,
        change};
    double *x = carried + @MEANS@;
    for (int i = 0; i < 8; i++)
        x[i] += brief * (given[i] - x[i]);
    const double rate = x[7];
    carried[@RESTLESS@] += quiet * (fabs(pitch - x[0]) - carried[@RESTLESS@]);
    carried[@SLOW_RATE@] += quiet * (rate - carried[@SLOW_RATE@]);
    const int still = depth < @SURFACE@ || (depth < @SHALLOW@ && fabs(rate) < @RESTING_RATE@);
    carried[@SINCE_AFLOAT@] = still ? 0.0 : carried[@SINCE_AFLOAT@] + @PERIOD@;
    carried[@SINCE_UPDATE@] += @PERIOD@;
    carried[@STARTED@] = 1.0;
    const double zero[3] = {0.0, 0.0, 0.0};
    double out[4] = {0.0, 0.0, 0.0, 0.0};
    const int gliding = gt_balance(x, c, carried + @WARM@, @SETTLED@, out)
        || gt_balance(x, c, zero, @ITERATIONS@, out);
    for (int i = 0; i < 5; i++)
        estimated[i] = 0.0;
    if (!gliding)
        return;
    const int steady = carried[@SINCE_AFLOAT@] > @AFLOAT_S@ && carried[@RESTLESS@] < @QUIET_PITCH@
        && fabs(rate - carried[@SLOW_RATE@]) < @QUIET_RATE@ && fabs(out[3]) > @LEAST_SINE@
        && rate * out[3] > 0.0;
    if (steady && carried[@SINCE_UPDATE@] > @EVERY_S@) {
        carried[@SINCE_UPDATE@] = 0.0;
        carried[@SPREAD@] = gt_correct(c, cov, x, rate, begin->rate, out);
    }
    memcpy(carried + @WARM@, out, 3 * sizeof *out);
    estimated[2] = out[1];
    if (!still) {
        estimated[0] = gt_surge(out, rate);
        estimated[1] = estimated[0] * tan(out[2]) / cos(out[1]);
        estimated[3] = steady;
        estimated[4] = carried[@SPREAD@] * fmax(estimated[0], @LEAST_SURGE@);
    }
}
"""
