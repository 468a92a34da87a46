"""C export: a run's networks with their features as one C99 header, for on-board use.

    glider_reset(&state);
    if (glider_step(&state, &sample, &velocity)) ... velocity.surge, velocity.sway [m/s]

A sample holds the channels that the features read, by their schema names and in their units. The
members of an ensemble are averaged. The code allocates nothing, calls no library function but
sqrtf, and has no double, which small processors compute in software.
"""

from __future__ import annotations

import dataclasses
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence
from learn.networks import c_step
from learn.networks.c_step import indented
from learn.networks.network_estimator import FASTEST
from learn.networks.onnx_export import TOLERANCE, Parity
from learn.networks.predictor import Ensemble, Predictor
from twin.errors import InputError, StoreError
from twin.navigation import c_math
from twin.navigation.c_math import CFeatures, c_features, number, table
from twin.navigation.channel_guard import C_PRELUDE, ChannelGuard
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_c import NUMBERS, c_flight
from twin.navigation.flight_filter_kernels import OUTPUTS
from twin.navigation.settings import ESTIMATED, MIXED, estimate, estimate_adapted, sources
from twin.records.schema import VARIABLES
from twin.records.storage.whole import whole_file
from twin.vehicle.vehicle import Vehicle

NAME = "glider_velocity.h"
"""Name of the header file."""
BEYOND = 1e-3
"""[1] Fraction of samples that may differ by more than TOLERANCE: rounding errors of float32 can
grow a thousandfold while a hull stalls or turns over."""
FLAGS = (
    *("-std=c99", "-O3", "-pedantic"),
    *("-Wall", "-Wextra", "-Wdouble-promotion", "-Werror"),
)
"""Compiler options of the check, none of them specific to a processor."""


def c_header(
    networks: Mapping[str, Ensemble], period: float, vehicle: Vehicle | None = None
) -> str:
    """Text of the C header.

    Args:
      networks: ensembles surge and sway, with the same features.
      period: [s] between samples.
      vehicle: vehicle with its file's parameters; needed if networks read estimated channels.

    Raises:
      InputError: a type of network or a feature has no C code, or the vehicle is missing.
    """
    features = networks["surge"].members[0].features
    for ensemble in networks.values():
        assert all(member.features == features for member in ensemble.members)
    read = c_features(features, period)
    members = {
        f"{velocity}_{k}": member
        for velocity, ensemble in networks.items()
        for k, member in enumerate(ensemble.members)
    }
    functions = "\n".join(
        member.network.c_step().function(f"gt_{name}_network") + "\n" + _scaled(name, member)
        for name, member in members.items()
    )
    states = "\n".join(
        f"    float {name}[{max(1, member.network.state_size)}];"
        for name, member in members.items()
    )
    measured = sources(read.channels)
    sample = "\n".join(f"    float {c}; /* [{_unit(c)}] */" for c in measured)
    flight, flight_state, outside = "", "", ""
    held = networks["surge"].tether is not None
    tether_state = (
        "    float lasting; /* mean difference from the flight filter over a minute */\n" * held
    )
    if set(read.channels) & set(ESTIMATED):
        if vehicle is None:
            raise InputError("these networks read the flight filter: give c_header the vehicle")
        start, spread = networks["surge"].start, networks["surge"].spread
        filters = [FlightFilter(vehicle, period, spread)]
        if start is not None:
            filters.append(FlightFilter(vehicle, period, spread, start))
        flight = c_flight(*filters)
        flight_state = f"    float flight[{len(filters)}][{NUMBERS}];\n"
        familiar = networks["surge"].familiar
        outside = "" if familiar is None else familiar.c_function(filters[0].model.prior)
    of = "" if vehicle is None else f" For the vehicle {vehicle.name.replace('*/', '')} alone.\n *"
    return f"""\
/* Surge and sway of a vehicle through the water from its sensors, by trained networks.
 *{of}
 * Made by `learn export --to c`. C99, float throughout, no allocation, no library but sqrtf.
 *
 *     glider_state state;
 *     glider_velocity velocity;
 *     glider_reset(&state);
 *     ... one sample every {period:g} s, from the launch on:
 *     if (glider_step(&state, &sample, &velocity)) ...
 *
 * Do not compile it with -ffast-math: the code tests for values that are not finite.
 */
#ifndef GLIDER_VELOCITY_H
#define GLIDER_VELOCITY_H

#include <math.h>
#include <stddef.h>
#include <string.h>

#define GLIDER_PERIOD {number(period)} /* [s] */

typedef struct {{
{sample}
}} glider_sample;

/* Velocity through the water, in body axes. */
typedef struct {{
    float surge; /* [m s-1] forward */
    float sway;  /* [m s-1] to starboard */
    /* [m s-1] half width of the interval that holds 68 % of the errors; INFINITY: not known */
    float surge_deviation, sway_deviation;
}} glider_velocity;

/* State that the next step depends on; it may be copied and stored as bytes. */
typedef struct {{
    float window[{read.windows}];
    float last[{len(measured)}], age[{len(measured)}]; /* last good values and their ages */
    float mean_rate[{len(measured)}]; /* per second, of the depth; 0 of other channels */
    float lost; /* longest time that a channel was replaced, over 30 s; it fades */
{flight_state}{tether_state}    int count;
    int held; /* number of channels whose last good value replaced the sample's */
{states}
}} glider_state;

{c_math.PRELUDE}
{c_math.FEATURES_PRELUDE}
{c_step.PRELUDE}
{C_PRELUDE}
{flight}{read.functions}
{functions}
/* Resets the state to that before the first sample; call it at the launch. */
static inline void glider_reset(glider_state *state) {{ memset(state, 0, sizeof *state); }}

{outside}{_step(networks, read, len(features), period)}
#endif
"""


def _unit(channel: str) -> str:
    return VARIABLES[channel].units if channel in VARIABLES else "as stored"


def _scaled(name: str, member: Predictor) -> str:
    """C function from features to the velocity [m/s] of one member."""
    scales, count = member.normalisation, len(member.features)
    body = f"""\
{table("mean", scales.mean)}
{table("scale", scales.scale)}
float x[{count}];
for (int i = 0; i < {count}; i++)
    x[i] = (feature[i] - mean[i]) / scale[i];
return {number(scales.target_scale)} * gt_{name}_network(state, x) \
+ {number(scales.target_mean)};"""
    head = f"static inline float gt_{name}(float *state, const float *feature) /* [m s-1] */"
    return f"{head}\n{{\n{indented(body)}\n}}\n"


def _step(networks: Mapping[str, Ensemble], read: CFeatures, count: int, period: float) -> str:
    guard = ChannelGuard(sources(read.channels), period)
    estimated = [c for c in ESTIMATED if c in read.channels]
    flight, filters = [], 0
    if estimated:
        filters = 1 + (networks["surge"].start is not None)  # the networks' input; the adapted one
        flight = [
            f"float estimated[{filters}][{len(OUTPUTS)}];",
            f"for (int k = 0; k < {filters}; k++)",
            "    gt_flight(gt_begins + k, state->flight[k], sample, estimated[k]);",
        ]
    statements = read.statements
    for channel in estimated:
        place = f"estimated[0][{ESTIMATED.index(channel)}]"
        statements = statements.replace(f"sample->{channel}", place)
    said = []
    wider = "gt_most(1.0f, state->lost)"
    if networks["surge"].familiar is not None:
        wider = "gt_most(1.0f, glider_outside(state))"
    for velocity, ensemble in networks.items():
        members = range(len(ensemble.members))
        total = " + ".join(f"gt_{velocity}_{k}(state->{velocity}_{k}, feature)" for k in members)
        mean = f"({total}) / {len(members)}.0f"
        known = ensemble.interval
        interval = f"{number(known)} * {wider}" if known else "INFINITY"
        if velocity == "surge" and (tether := ensemble.tether) is not None:
            nearest = f"estimated[{filters - 1}][{OUTPUTS.index('surge')}]"
            said.append(f"const float loose = gt_bounded({mean}, {number(FASTEST)});")
            said += tether.c_statements("loose", nearest, period)
            mean = f"loose - {tether.c_off()}"
        if velocity == "surge" and ensemble.adapted is not None:
            filtered, steady, sd = (f"estimated[1][{OUTPUTS.index(n)}]" for n in MIXED)
            own = number(ensemble.adapted.deviation**2)
            said.append(f"const float own = {mean}, sd = {sd};")
            said.append(f"const float weight = {steady} * {own} / ({own} + sd * sd);")
            mean = f"own + weight * ({filtered} - own)"
            left = f"{number(known**2)} - weight * {own}, weight * sd * sd"
            interval = f"sqrtf(gt_most({left}))" if known else "INFINITY"
        said.append(f"velocity->{velocity} = gt_bounded({mean}, {number(FASTEST)});")
        said.append(f"velocity->{velocity}_deviation = {interval};")
    body = "\n".join(
        [
            guard.c_statements(),
            *flight,
            f"float feature[{count}];",
            statements,
            *said,
            f"if (state->count < {read.longest})\n    state->count++;",
            "return 1;",
        ]
    )
    return f"""\
/* Processes one sample. Returns 1; or 0, without a velocity, until every channel had a good value.
 * A value that is not finite, impossible or out of reach is replaced by the last good value, a
 * depth by the last good one carried on by its rate. */
static inline int glider_step(glider_state *state, const glider_sample *sample,
                              glider_velocity *velocity)
{{
{indented(body)}
}}
"""


def export_c(
    networks: Mapping[str, Ensemble],
    path: Path,
    mission: MissionSequence,
    vehicle: Vehicle | None = None,
) -> Parity:
    """Write the header, compile it and compare it with the networks over a whole mission.

    Raises:
      InputError: there is no C compiler, or a type of network or a feature has no C code.
      StoreError: the file cannot be written, does not compile, or differs from the networks by more
        than TOLERANCE in root mean square or at more than BEYOND of the samples. Then an earlier
        file at `path` stays.
    """
    compiler, text = find_compiler(), c_header(networks, mission.period, vehicle)
    mission = _as_given(mission, networks["surge"], vehicle)
    with whole_file(path) as place:
        place.write_text(text, encoding="utf-8")
        said, step_us = run_c(place, networks, mission, compiler)
        wanted = np.stack([networks[name].predict([mission])[0][0] for name in VELOCITIES], 1)
        off = np.abs(said[:, :2] - wanted)
        largest, rms = float(off.max()), float(np.sqrt(np.mean(off**2, 0)).max())
        beyond = float(np.mean(~(off <= TOLERANCE).all(1)))
        if not (beyond <= BEYOND and rms <= TOLERANCE):
            raise StoreError(
                f"the C code differs from the networks on mission {mission.index} by {rms:.2g} m/s "
                f"in root mean square, {largest:.2g} m/s at most, and by more than {TOLERANCE:g} "
                f"m/s at {beyond:.2%} of the samples (allowed {TOLERANCE:g} m/s and {BEYOND:.1%}); "
                "it was not kept. A network with a state that amplifies rounding does so: train it "
                "longer, or with another --seed"
            )
    return Parity(path, mission.index, mission.samples, largest, rms, step_us)


def _as_given(
    mission: MissionSequence, networks: Ensemble, vehicle: Vehicle | None
) -> MissionSequence:
    """Round a mission's signals to float32, as in a C sample; filled gaps of logs are float64."""
    signals = {n: v.astype(np.float32).astype(np.float64) for n, v in mission.signals.items()}
    if vehicle is not None:
        period, spread = mission.period, networks.spread
        signals |= estimate(signals, vehicle, period, mission=mission.index, spread=spread)
        if networks.start is not None:
            signals |= estimate_adapted(signals, vehicle, period, networks.start, spread)
    return dataclasses.replace(mission, signals=signals)


VELOCITIES = ("surge", "sway")
"""Velocities in the order in which the checking program writes them."""
MAIN = """\
#include "{header}"
#include <stdio.h>
#include <time.h>

static float given[{samples}][{channels}];
static float found[{samples}][4];

int main(void)
{{
    static glider_state state;
    glider_velocity velocity;
    if (fread(given, sizeof given[0], {samples}, stdin) != {samples})
        return 1;
    glider_reset(&state);
    const clock_t start = clock();
    for (int k = 0; k < {samples}; k++) {{
        const float *v = given[k];
        const glider_sample sample = {{{fields}}};
        if (!glider_step(&state, &sample, &velocity))
            return 2;
        found[k][0] = velocity.surge;
        found[k][1] = velocity.sway;
        found[k][2] = velocity.surge_deviation;
        found[k][3] = velocity.sway_deviation;
    }}
    fprintf(stderr, "%.9g", 1e6 * (double)(clock() - start) / CLOCKS_PER_SEC / {samples});
    return fwrite(found, sizeof found[0], {samples}, stdout) != {samples};
}}
"""


def find_compiler() -> tuple[str, ...]:
    """Command of the C compiler: $CC, or `cc`.

    Raises:
      InputError: the program is not installed.
    """
    command = tuple(shlex.split(os.environ.get("CC", ""))) or ("cc",)
    if shutil.which(command[0]) is None:
        raise InputError(
            f"the C compiler {command[0]!r} is missing, with which the exported code is "
            "compared with the networks: install one, such as gcc, or name it in the environment "
            "variable CC"
        )
    return command


def run_c(
    header: Path,
    networks: Mapping[str, Ensemble],
    mission: MissionSequence,
    compiler: tuple[str, ...],
) -> tuple[NDArray[np.float32], float]:
    """Compile a header, and run a mission through it.

    Returns:
      Surge, sway and their intervals' half-widths [m/s], (time, 4), and the time of a step [us].

    Raises:
      StoreError: the program does not compile, or fails.
    """
    features = networks["surge"].members[0].features
    channels = sources(c_features(features, mission.period).channels)
    given = np.stack([mission.signals[name] for name in channels], 1).astype(np.float32)
    source = MAIN.format(
        header=header.name,
        samples=len(given),
        channels=len(channels),
        fields=", ".join(f".{name} = v[{k}]" for k, name in enumerate(channels)),
    )
    with tempfile.TemporaryDirectory() as folder:
        place, program = Path(folder) / "check.c", Path(folder) / "check"
        place.write_text(source, encoding="utf-8")
        command = [*compiler, *FLAGS, f"-I{header.parent}", str(place), "-o", str(program), "-lm"]
        made = subprocess.run(command, capture_output=True, text=True)
        if made.returncode:
            raise StoreError(f"{header} does not compile: {' '.join(made.stderr.split())[:400]}")
        done = subprocess.run([program], input=given.tobytes(), capture_output=True)
    if done.returncode:
        raise StoreError(f"the program made of {header} ended with code {done.returncode}")
    return np.frombuffer(done.stdout, np.float32).reshape(-1, 4), float(done.stderr)
