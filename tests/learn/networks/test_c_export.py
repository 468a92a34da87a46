"""The C code of networks and features against Python."""

import dataclasses
import os
import re
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from glides import changed, glides
from navigation import PERIOD, trimmed_mission

from benchmarks import onboard_cortex
from learn.data.dataset import MissionSequence
from learn.data.sequences import Normalisation
from learn.networks.base import Network, NetworkConfig, build_network
from learn.networks.c_export import FLAGS, c_header, export_c, find_compiler, run_c
from learn.networks.onnx_export import TOLERANCE
from learn.networks.predictor import Adapted, Ensemble, Predictor
from learn.seams import NETWORKS
from twin.errors import InputError, StoreError
from twin.navigation.c_math import c_features
from twin.navigation.features import FEATURES, FLIGHT, Feature, Term, channels_of
from twin.navigation.flight_filter import FlightSpread, FlightStart
from twin.navigation.settings import estimate, sources
from twin.vehicle.vehicle import load_vehicle

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler, cc")

SEEN = ("sin_roll", "pitch_change", "glide_speed_slow", "gravity_glide_speed", "pump")
PLAIN = tuple(name for name, f in FEATURES.items() if not f.group.startswith(FLIGHT))
"""Features that need no vehicle."""


@pytest.fixture(scope="module")
def mission():
    """It turns through north, and every channel moves."""
    signals = trimmed_mission(400)
    rng = np.random.default_rng(0)
    for name in channels_of(PLAIN):
        base = np.asarray(signals.get(name, np.zeros(400)), float)
        signals[name] = base + np.sin(np.arange(400) / 20) + 0.1 * rng.normal(size=400)
        if name.endswith("_shift"):  # a battery that moves by a metre is none
            signals[name] *= 0.3
    signals["measured_heading"] = np.mod(350.0 + np.arange(400) / 4, 360.0)
    signals = {name: np.float64(np.float32(values)) for name, values in signals.items()}
    return MissionSequence(index=4, split="test", period=PERIOD, signals=signals)


def networks_of(kind, features, mission, members=1, **sizes):
    matrix = mission.features(features).astype(float)
    torch.manual_seed(3)

    def member(target):
        config = NetworkConfig(kind=kind, inputs=len(features), period=PERIOD, **sizes)
        scales = Normalisation(
            features=tuple(features),
            mean=tuple(matrix.mean(0)),
            scale=tuple(matrix.std(0) + 1e-3),
            target=target,
            target_mean=0.4 if target == "surge" else 0.0,
            target_scale=0.12,
        )
        return Predictor(build_network(config), scales)

    return {
        target: Ensemble(tuple(member(target) for _ in range(members)))
        for target in ("surge", "sway")
    }


@needs_compiler
@pytest.mark.parametrize(
    ("kind", "sizes"),
    [
        *((kind, {}) for kind in NETWORKS),
        ("ema", {"memories": (5.0,)}),
        ("elman", {"delays": 1, "layers": 1}),
        ("tcn", {"kernel": 1}),
        ("tcn", {"kernel": 2, "dilation": 3, "hidden": len(SEEN)}),
    ],
)
def test_every_kind_gives_in_c_what_it_gives_in_python(kind, sizes, mission, tmp_path):
    networks = networks_of(kind, SEEN, mission, **{"hidden": 7, "layers": 2, **sizes})
    parity = export_c(networks, tmp_path / "glider_velocity.h", mission)
    assert parity.largest < 1e-6
    assert parity.samples == 400
    # The comparison means something only if the velocities move.
    moved, _ = run_c(parity.path, networks, mission, find_compiler())
    assert moved[:, :2].std(0).min() > 20 * TOLERANCE


@needs_compiler
def test_every_feature_is_in_c_what_it_is_in_python(mission, tmp_path, monkeypatch):
    """A network that passes one feature through shows it; each program has two of them."""
    quick = tuple(flag for flag in FLAGS if not flag.startswith("-O"))
    monkeypatch.setattr("learn.networks.c_export.FLAGS", quick)
    names = PLAIN
    matrix = mission.features(names)
    networks = networks_of("mlp", names, mission, hidden=len(names), layers=1)
    for first in range(0, len(names), 2):
        shown = dict(zip(networks, names[first : first + 2], strict=False))
        for target, name in shown.items():
            network = networks[target].members[0].network
            with torch.no_grad():
                for p in network.parameters():
                    p.zero_()
                network.body[0].weight[0, names.index(name)] = 1.0
                network.body[2].weight[0, 0] = 1.0
        header = tmp_path / f"{first}.h"
        header.write_text(c_header(networks, PERIOD))
        found, _ = run_c(header, networks, mission, find_compiler())
        for column, (target, name) in zip(found.T, shown.items(), strict=False):
            scales = networks[target].members[0].normalisation
            place = names.index(name)
            wanted = np.tanh(scales.inputs(matrix)[:, place])
            through = (column - scales.target_mean) / scales.target_scale
            digit = np.spacing(np.float32(np.abs(matrix[:, place]).max())) / scales.scale[place]
            assert np.abs(through - wanted).max() < 3e-6 + 2.0 * digit, name
            assert wanted.std() > 0.02, name


@needs_compiler
def test_the_flight_filter_is_in_c_what_it_is_in_python(tmp_path):
    """Over dives and climbs, with what it learned of a vehicle with too much drag."""
    signals, _, _ = glides(changed(drag=1.08), pitches=(-25.0, 32.0, -36.0))
    vehicle = load_vehicle()
    signals |= estimate(signals, vehicle, PERIOD, mission=4)
    glide = MissionSequence(index=4, split="test", period=PERIOD, signals=signals)
    names = ("sin_pitch", "flight_surge", "flight_sway", "flight_attack", "flight_steady")
    networks = networks_of("ema", names, glide, hidden=6, layers=1)
    parity = export_c(networks, tmp_path / "glider_velocity.h", glide, vehicle)
    assert parity.largest < 2e-6
    found, _ = run_c(parity.path, networks, glide, find_compiler())
    assert found[:, :2].std(0).min() > 20 * TOLERANCE
    assert "double" not in re.sub(r"/\*.*?\*/", "", parity.path.read_text(), flags=re.DOTALL)
    with pytest.raises(InputError, match="flight filter: give c_header the vehicle"):
        c_header(networks, PERIOD)


STACK = """
#define _GNU_SOURCE
#include "glider_velocity.h"
#include <pthread.h>
#include <stdio.h>
static unsigned char room[1 << 17];
static glider_state state;
static glider_velocity velocity;
static glider_sample samples[{count}] = {{{samples}}};
static int steps;
static void *work(void *unused)
{{
    for (int k = 0; k < steps; k++)
        glider_step(&state, samples + k, &velocity);
    return unused;
}}
static long touched(int count) /* bytes of the stack that a thread of so many steps writes to */
{{
    pthread_attr_t attributes;
    pthread_t thread;
    steps = count;
    memset(room, 0xa5, sizeof room);
    pthread_attr_init(&attributes);
    pthread_attr_setstack(&attributes, room, sizeof room);
    pthread_create(&thread, &attributes, work, NULL);
    pthread_join(thread, NULL);
    long low = 0;
    while (room[low] == 0xa5)
        low++;
    return (long)sizeof room - low;
}}
int main(void)
{{
    glider_reset(&state);
    const long idle = touched(0), busy = touched({count});
    printf("%ld", busy - idle);
    return 0;
}}
"""


def adapted_to_heavy(**sizes):
    """A mission with corrections of the flight filter on the way, adapted networks for it, and its
    vehicle."""
    signals, _, _ = glides(changed(drag=1.2), pitches=(-25.0, 32.0))
    vehicle = load_vehicle()
    signals |= estimate(signals, vehicle, PERIOD, mission=0)
    glide = MissionSequence(index=0, split="test", period=PERIOD, signals=signals)
    names = tuple(n for n, f in FEATURES.items() if set(channels_of([n])) <= set(signals))
    assert len(names) > 20
    start = FlightStart.of(np.zeros(7), np.diag(FlightSpread().prior ** 2), 1e-2)
    networks = {
        name: dataclasses.replace(e, adapted=Adapted(start=start, deviation=0.002), interval=0.01)
        for name, e in networks_of("ema", names, glide, **sizes).items()
    }
    return glide, networks, vehicle


@needs_compiler
def test_an_adapted_step_needs_less_than_two_kilobytes_of_stack(tmp_path):
    """Networks of the default size, with corrections of the flight filter on the way."""
    glide, networks, vehicle = adapted_to_heavy(hidden=50, layers=3)
    (tmp_path / "glider_velocity.h").write_text(c_header(networks, PERIOD, vehicle))
    channels = sources(channels_of(networks["surge"].members[0].features))
    rows = np.stack([glide.signals[c] for c in channels], 1)[:400]
    samples = ",".join("{" + ",".join(map(repr, row)) + "}" for row in rows.tolist())
    (tmp_path / "main.c").write_text(STACK.format(count=len(rows), samples=samples))
    for optimised in ("-O2", "-Os"):
        flags = [f for f in FLAGS if not f.startswith("-O")]
        command = [*find_compiler(), *flags, optimised, "-pthread", "main.c", "-o", "main", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        bound = os.environ | {"LD_BIND_NOW": "1"}  # a first call of libm's would bind it
        said = subprocess.run([tmp_path / "main"], capture_output=True, check=True, env=bound)
        assert 500 < int(said.stdout) < 2048, optimised


@needs_compiler
def test_a_cortex_m4f_computes_the_same_without_floats_in_software():
    for package in ("ziglang", "unicorn"):
        pytest.importorskip(package, reason=f"a Cortex-M4F needs the package {package}")
    glide, networks, vehicle = adapted_to_heavy(hidden=6, layers=1)
    cost, here = onboard_cortex.measured(networks, glide, vehicle, samples=400)
    assert np.abs(cost.velocities - here[:400]).max() < 1e-6
    assert here[:400, 0].std() > 20 * TOLERANCE
    assert cost.image.software() == []
    assert 500 < cost.stack < 2048
    instructions = cost.spent[:, 0]
    assert instructions.max() > 3 * np.median(instructions) > 3000  # a correction
    assert any("software: none" in line for line in cost.lines(here))


def test_instructions_of_a_cortex_m4f_are_counted_and_routines_in_software_are_known():
    """Two of two bytes, and two of four: nop, ldr; vadd.f32, vdiv.f32."""
    code = struct.pack("<6H", 0xBF00, 0x6808, 0xEE30, 0x0A20, 0xEE80, 0x0A20)
    assert onboard_cortex.cost(code) == (4, 1 + 2 + 1 + 14 + 2)
    slow = ("__aeabi_dmul", "__aeabi_f2d", "__muldf3", "__aeabi_fadd", "__extendsfdf2", "__fixdfsi")
    assert all(map(onboard_cortex.SOFTWARE.match, slow))
    assert not any(map(onboard_cortex.SOFTWARE.match, ("memcpy", "__aeabi_memcpy", "gt_add")))


@needs_compiler
def test_members_are_averaged(mission, tmp_path):
    networks = networks_of("ema", SEEN, mission, members=3, hidden=5, layers=1)
    parity = export_c(networks, tmp_path / "velocity.h", mission)
    assert parity.largest < 1e-6
    alone = {name: Ensemble(e.members[:1]) for name, e in networks.items()}
    found, _ = run_c(parity.path, networks, mission, find_compiler())
    assert np.abs(found[:, 0] - alone["surge"].predict([mission])[0][0]).max() > 1e-3


@needs_compiler
def test_absurd_values_come_into_no_memory_in_c_either(mission, tmp_path):
    """Not finite, impossible or out of reach: the last good value stands in, and is counted."""
    networks = networks_of("ema", ("sin_pitch", "depth_rate"), mission, hidden=4, layers=1)
    header = tmp_path / "glider_velocity.h"
    header.write_text(c_header(networks, PERIOD))
    main = """
#include "glider_velocity.h"
int main(void)
{
    const float bad[] = {NAN, -INFINITY, 65535.0f, 1e30f, 900.0f};
    glider_state state, clean;
    glider_velocity velocity = {.surge = 9.0f}, wanted;
    glider_sample sample = {.measured_pitch = -20.0f, .measured_depth = NAN};
    glider_reset(&state);
    if (glider_step(&state, &sample, &velocity) || velocity.surge != 9.0f) return 1;
    glider_reset(&state);
    glider_reset(&clean);
    for (int k = 0; k < 5; k++) {
        sample.measured_depth = 3.0f;
        if (!glider_step(&state, &sample, &velocity) || state.held != 0) return 2;
        if (!glider_step(&clean, &sample, &wanted)) return 3;
        sample.measured_depth = bad[k];
        if (!glider_step(&state, &sample, &velocity) || state.held != 1) return 4;
        sample.measured_depth = 3.0f;
        if (!glider_step(&clean, &sample, &wanted)) return 5;
        if (velocity.surge != wanted.surge || velocity.sway != wanted.sway) return 6;
    }
    for (int k = 0; k < 400; k++) /* where it stays it is believed in the end */
        sample.measured_depth = 900.0f, glider_step(&state, &sample, &velocity);
    return state.held ? 7 : 0;
}
"""
    (tmp_path / "main.c").write_text(main)
    watched = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    for more in ((), watched):
        command = [*find_compiler(), *FLAGS, *more, "main.c", "-o", "main", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        assert subprocess.run([tmp_path / "main"]).returncode == 0


@needs_compiler
def test_code_that_differs_is_not_kept(mission, tmp_path, monkeypatch):
    networks = networks_of("ema", SEEN, mission, hidden=4, layers=1)
    place = tmp_path / "velocity.h"
    place.write_text("the old one")
    kind = NETWORKS["ema"]
    right = kind.c_step

    def wrong(self):
        step = right(self)
        return dataclasses.replace(step, body=step.body.replace("return out[0]", "return -out[0]"))

    monkeypatch.setattr(kind, "c_step", wrong)
    with pytest.raises(StoreError, match=r"the C code differs from .* was not kept"):
        export_c(networks, place, mission)
    monkeypatch.setattr(
        kind, "c_step", lambda self: dataclasses.replace(right(self), body="return 0")
    )
    with pytest.raises(StoreError, match=r"velocity\.h does not compile"):
        export_c(networks, place, mission)
    assert place.read_text() == "the old one"


def test_a_kind_without_c_code_says_so(mission, monkeypatch):
    networks = networks_of("mlp", SEEN, mission, hidden=4, layers=1)
    monkeypatch.setattr(NETWORKS["mlp"], "c_step", Network.c_step)
    with pytest.raises(InputError, match=r"network 'mlp' has no C code: .* has it: ema, elman"):
        c_header(networks, PERIOD)


def test_a_feature_without_c_code_says_so():
    terms = (Term(channel="measured_pitch"), Term(channel="measured_roll"))
    tilt = Feature(name="tilt", group="mine", unit="1", terms=terms, combine=np.hypot)
    with pytest.raises(InputError, match="feature 'tilt' combines its terms in Python alone"):
        c_features([tilt], PERIOD)
    body = "return sqrt(t[0] * t[0] + t[1] * t[1]);"
    assert body in c_features([dataclasses.replace(tilt, c=body)], PERIOD).functions


@pytest.mark.parametrize("name", FEATURES)
def test_every_feature_has_c_code(name):
    assert c_features([name], PERIOD).channels == FEATURES[name].channels


def test_without_a_compiler_the_error_says_what_to_do(mission, monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "no-such-cc -O2")
    networks = networks_of("mlp", SEEN, mission, hidden=4, layers=1)
    with pytest.raises(InputError, match=r"'no-such-cc' is missing.*environment variable CC"):
        export_c(networks, tmp_path / "velocity.h", mission)
    assert not list(Path(tmp_path).iterdir())
