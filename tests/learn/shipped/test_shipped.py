"""Shipped networks: what they hold, where they suit, and that they run without torch."""

import hashlib
import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from learn.networks.base import NetworkConfig, build_network
from learn.networks.plain import PlainAverages
from learn.networks.shipped_velocities import ShippedNetworks
from learn.run import open_run
from learn.shipped import FOLDER, SORTS, shipped_run, substituted
from twin.errors import InputError
from twin.vehicle.vehicle import load_vehicle

LARGEST = 2_000_000
NAMES = sorted(path.parent.name for path in FOLDER.glob("*/run.json"))
WITHOUT = (
    "import sys; sys.argv = sys.argv[1:]; from {0}.__main__ import main; code = main(); "
    "assert 'torch' not in sys.modules; sys.exit(code)"
)


def test_all_files_together_are_at_most_two_megabytes():
    assert NAMES
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) <= LARGEST


@pytest.mark.parametrize("name", NAMES)
def test_a_card_tells_recipe_hours_hash_and_licence(name):
    card = open_run(name).description["card"]
    assert card["licence"] == "Apache-2.0"
    assert card["hours"] > 0
    assert len(card["rows_sha256"]) == hashlib.sha256().digest_size * 2
    assert tuple(card["vehicles"]) == SORTS[name.partition("-")[0]]


@pytest.mark.parametrize("vehicle", [v for sort in SORTS if sort in NAMES for v in SORTS[sort]])
def test_every_vehicle_of_the_training_has_networks_at_any_period(vehicle):
    for period in (0.5, 1.0, 7.0, 30.0):
        run, absent = shipped_run(load_vehicle(vehicle), period)
        assert absent == ()
        networks = run.networks(load_vehicle(vehicle))
        assert networks["surge"].members[0].network.period == period


def test_a_period_outside_of_the_training_is_refused():
    with pytest.raises(InputError, match=r"outside of 0\.5 to 30 s"):
        shipped_run(load_vehicle("glider"), 60.0)


def test_plain_networks_equal_torch_at_another_period():
    torch.manual_seed(1)
    config = {"kind": "ema", "inputs": 3, "period": 4.0, "hidden": 8, "layers": 2,
              "memories": (2.0, 30.0)}  # fmt: skip
    network = build_network(NetworkConfig(**config))
    weights = {name: value.numpy() for name, value in network.state_dict().items()}
    plain = PlainAverages(config, weights)
    x = np.random.default_rng(0).standard_normal((300, 3)).astype(np.float32)
    with torch.no_grad():
        wanted = network(torch.from_numpy(x)[:, None])[0][:, 0, 0].numpy()
    for one in (plain, network):
        state, stepped = one.begin(), []
        for row in x:
            y, state = one.step_sample(row, state)
            stepped.append(y)
        np.testing.assert_allclose(one.run_missions([x])[0], wanted, atol=1e-5)
        np.testing.assert_allclose(stepped, wanted, atol=1e-5)


def test_substituted_rates_are_those_of_a_steady_turn():
    period, turn = 1.0, np.deg2rad(1.5)
    time = np.arange(50.0)
    pitch, roll = np.full(50, -25.0), np.full(50, 10.0)
    signals = {"measured_pitch": pitch, "measured_roll": roll, "measured_depth": time,
               "measured_heading": np.mod(350.0 + 1.5 * time, 360.0)}  # fmt: skip
    names = ("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate")
    found = substituted(signals, period, (*names, "measured_density"))
    theta, phi = np.deg2rad(pitch[0]), np.deg2rad(roll[0])
    wanted = (-turn * np.sin(theta), turn * np.cos(theta) * np.sin(phi),
              turn * np.cos(theta) * np.cos(phi))  # fmt: skip
    for name, value in zip(names, wanted, strict=True):
        np.testing.assert_allclose(found[name][1:], value, rtol=1e-9)
    assert (np.diff(found["measured_density"]) > 0.0).all()


@pytest.mark.skipif("gliders" not in NAMES, reason="no networks of gliders are shipped here")
def test_velocities_without_torch_say_what_wins(tmp_path):
    store = tmp_path / "m.zarr"
    words = ["factory", "generate", "--preset", "field", "--hours", "2", "--engine", "lanes",
             "--workers", "1", "--out", str(store)]  # fmt: skip
    subprocess.run([sys.executable, "-m", *words], check=True, capture_output=True)
    made = subprocess.run(
        [sys.executable, "-c", WITHOUT.format("learn"), "learn", "velocities", str(store),
         "--out", str(tmp_path / "v.csv"), "--json"], capture_output=True, text=True,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    answer = json.loads(made.stdout)
    errors = answer["track_error_percent"]
    assert answer["method"] == min(errors, key=errors.get)
    assert {"network", "flight_filter", "ekf"} <= set(errors)
    rows = np.loadtxt(tmp_path / "v.csv", delimiter=",", skiprows=1)
    assert np.isfinite(rows).all()
    words = ["simulate", "--navigate", "network", "--duration", "120", "--out"]
    flown = [sys.executable, "-c", WITHOUT.format("twin"), "twin", *words, str(tmp_path / "r.zarr")]
    assert subprocess.run(flown, capture_output=True).returncode == 0
    with ShippedNetworks(store) as shipped:
        if answer["method"] == "network":
            (one, *_) = shipped.predictions()
            first = one.mission, one.time, one.surge
        else:
            (first, *_) = shipped.baseline(answer["method"])
    np.testing.assert_allclose(rows[rows[:, 0] == 0, 2], first[2], atol=1e-5)
