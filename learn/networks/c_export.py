"""C export: a run's networks with their features as one C99 header, for on-board use.

    glider_reset(&state);
    if (glider_step(&state, &sample, &velocity)) ... velocity.surge, velocity.sway [m/s]

A sample holds the channels that the features read, by their schema names and in their units. The
members of an ensemble are averaged. There is no allocation and no library but math; features are
double, since depth is differentiated, and networks are float32.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence
from learn.networks import c_step
from learn.networks.c_step import indented
from learn.networks.network_estimator import FASTEST
from learn.networks.onnx_export import TOLERANCE, Parity
from learn.networks.predictor import Ensemble, Predictor
from twin.errors import InputError, StoreError
from twin.navigation.channel_guard import C_PRELUDE, ChannelGuard
from twin.navigation.features import c_steps
from twin.navigation.features.c_steps import CFeatures, c_features
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_c import NUMBERS, c_flight
from twin.navigation.flight_filter_kernels import OUTPUTS
from twin.navigation.settings import ESTIMATED, MIXED, sources
from twin.records.schema import VARIABLES
from twin.records.storage.whole import whole_file
from twin.vehicle.vehicle import Vehicle

NAME = "glider_velocity.h"
"""Of the file."""
FLAGS = (
    *("-std=c99", "-O3", "-pedantic"),
    *("-Wall", "-Wextra", "-Wdouble-promotion", "-Werror"),
)
"""How the check compiles it; nothing in it is special to a processor."""


def c_header(
    networks: Mapping[str, Ensemble], period: float, vehicle: Vehicle | None = None
) -> str:
    """The header's text.

    Args:
      networks: surge and sway, each of the same features.
      period: [s] between samples.
      vehicle: as its file says; only networks that read estimated channels need it.

    Raises:
      InputError: a kind of network or a feature has no C code, or the vehicle is needed.
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
    sample = "\n".join(f"    double {c}; /* [{_unit(c)}] */" for c in measured)
    flight, flight_state, outside = "", "", ""
    if set(read.channels) & set(ESTIMATED):
        if vehicle is None:
            raise InputError("these networks read the flight filter: give c_header the vehicle")
        start = networks["surge"].start
        filters = [FlightFilter(vehicle, period)]
        if start is not None:
            filters.append(FlightFilter(vehicle, period, start=start))
        flight = c_flight(*filters)
        flight_state = f"    double flight[{len(filters)}][{NUMBERS}];\n"
        familiar = networks["surge"].familiar
        outside = "" if familiar is None else familiar.c_function()
    return f"""\
/* Surge and sway of a vehicle through the water from its sensors, by trained networks.
 *
 * Made by `learn export --to c`. C99, no allocation, no library but math.
 *
 *     glider_state state;
 *     glider_velocity velocity;
 *     glider_reset(&state);
 *     ... one sample every {period:g} s, from the launch on:
 *     if (glider_step(&state, &sample, &velocity)) ...
 *
 * Do not compile it with -ffast-math: it has to know a value that is not finite.
 */
#ifndef GLIDER_VELOCITY_H
#define GLIDER_VELOCITY_H

#include <math.h>
#include <stddef.h>
#include <string.h>

#define GLIDER_PERIOD {period!r} /* [s] */

typedef struct {{
{sample}
}} glider_sample;

/* Through the water, body axes. */
typedef struct {{
    float surge; /* [m s-1] forward */
    float sway;  /* [m s-1] to starboard */
}} glider_velocity;

/* All that the next step depends on; it may be copied and kept as bytes. */
typedef struct {{
    double window[{read.windows}];
    double last[{len(measured)}], age[{len(measured)}]; /* of every channel: the last good value */
{flight_state}    int count;
    int held; /* channels whose last good value stands for the sample's */
{states}
}} glider_state;

{c_step.PRELUDE}
{c_steps.PRELUDE}
{C_PRELUDE}
{flight}{read.functions}
{functions}
/* Begin before the first sample, at the launch. */
static inline void glider_reset(glider_state *state) {{ memset(state, 0, sizeof *state); }}

{_step(networks, read, len(features), period)}{outside}
#endif
"""


def _unit(channel: str) -> str:
    return VARIABLES[channel].units if channel in VARIABLES else "as stored"


def _scaled(name: str, member: Predictor) -> str:
    """A function from features to the velocity of one member."""
    scales, count = member.normalisation, len(member.features)
    mean, scale = (
        c_step.table(key, torch.tensor(values)) for key, values in _input_scales(member).items()
    )
    body = f"""\
{mean}
{scale}
float x[{count}];
for (int i = 0; i < {count}; i++)
    x[i] = ((float)feature[i] - mean[i]) / scale[i];
return {c_step.number(scales.target_scale)} * gt_{name}_network(state, x) \
+ {c_step.number(scales.target_mean)};"""
    head = f"static inline float gt_{name}(float *state, const double *feature) /* [m s-1] */"
    return f"{head}\n{{\n{indented(body)}\n}}\n"


def _input_scales(member: Predictor) -> dict[str, tuple[float, ...]]:
    return {"mean": member.normalisation.mean, "scale": member.normalisation.scale}


def _step(networks: Mapping[str, Ensemble], read: CFeatures, count: int, period: float) -> str:
    guard = ChannelGuard(sources(read.channels), period)
    estimated = [c for c in ESTIMATED if c in read.channels]
    flight = []
    if estimated:
        filters = 1 + (networks["surge"].start is not None)  # as the networks read it; adapted
        flight = [
            f"double estimated[{filters}][{len(OUTPUTS)}];",
            f"for (int k = 0; k < {filters}; k++)",
            "    gt_flight(gt_begins + k, state->flight[k], sample, estimated[k]);",
        ]
    statements = read.statements
    for channel in estimated:
        place = f"estimated[0][{ESTIMATED.index(channel)}]"
        statements = statements.replace(f"sample->{channel}", place)
    means = []
    for velocity, ensemble in networks.items():
        members = range(len(ensemble.members))
        total = " + ".join(f"gt_{velocity}_{k}(state->{velocity}_{k}, feature)" for k in members)
        mean = f"({total}) / {len(members)}.0f"
        if velocity == "surge" and ensemble.adapted is not None:
            filtered, steady, sd = (f"(float)estimated[1][{OUTPUTS.index(n)}]" for n in MIXED)
            own = c_step.number(ensemble.adapted.deviation**2)
            means.append(f"const float own = {mean}, sd = {sd};")
            means.append(f"const float weight = {steady} * {own} / ({own} + sd * sd);")
            mean = f"own + weight * ({filtered} - own)"
        means.append(f"velocity->{velocity} = gt_bounded({mean}, {c_step.number(FASTEST)});")
    body = "\n".join(
        [
            guard.c_statements(),
            *flight,
            f"double feature[{count}];",
            statements,
            *means,
            f"if (state->count < {read.longest})\n    state->count++;",
            "return 1;",
        ]
    )
    return f"""\
/* One sample: 1, or 0 until every channel has had a good value; velocity is then as it was. What is
 * not finite, impossible or out of reach gives way to the last good value: state->held channels. */
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
    """Write the header, compile it and run a whole mission through it.

    Raises:
      InputError: there is no C compiler, or no C code of a kind of network or of a feature.
      StoreError: it cannot be written, does not compile, or differs by more than TOLERANCE from
        the networks; a file that was there is as it was.
    """
    compiler, text = find_compiler(), c_header(networks, mission.period, vehicle)
    with whole_file(path) as place:
        place.write_text(text, encoding="utf-8")
        velocities, step_us = run_c(place, networks, mission, compiler)
        wanted = np.stack([networks[name].predict([mission])[0][0] for name in VELOCITIES], 1)
        largest = float(np.abs(velocities - wanted).max())
        if not largest <= TOLERANCE:
            raise StoreError(
                f"the C code differs by {largest:.2g} m/s from the networks on mission "
                f"{mission.index} (allowed {TOLERANCE:g}); it was not kept. A network with a "
                "state that amplifies rounding does so: train it longer, or with another --seed"
            )
    return Parity(path, mission.index, mission.samples, largest, step_us)


VELOCITIES = ("surge", "sway")
"""In the order in which the checking program writes them."""
MAIN = """\
#include "{header}"
#include <stdio.h>
#include <time.h>

static double given[{samples}][{channels}];
static float found[{samples}][2];

int main(void)
{{
    static glider_state state;
    glider_velocity velocity;
    if (fread(given, sizeof given[0], {samples}, stdin) != {samples})
        return 1;
    glider_reset(&state);
    const clock_t start = clock();
    for (int k = 0; k < {samples}; k++) {{
        const double *v = given[k];
        const glider_sample sample = {{{fields}}};
        if (!glider_step(&state, &sample, &velocity))
            return 2;
        found[k][0] = velocity.surge;
        found[k][1] = velocity.sway;
    }}
    fprintf(stderr, "%.9g", 1e6 * (double)(clock() - start) / CLOCKS_PER_SEC / {samples});
    return fwrite(found, sizeof found[0], {samples}, stdout) != {samples};
}}
"""


def find_compiler() -> tuple[str, ...]:
    """The command of $CC, or `cc`.

    Raises:
      InputError: there is no such program.
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
      Surge and sway [m/s], (time, 2), and the time of a step [us].

    Raises:
      StoreError: it does not compile, or stops.
    """
    features = networks["surge"].members[0].features
    channels = sources(c_features(features, mission.period).channels)
    given = np.stack([mission.signals[name] for name in channels], 1).astype(np.float64)
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
    return np.frombuffer(done.stdout, np.float32).reshape(-1, 2), float(done.stderr)
