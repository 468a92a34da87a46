"""Logs of a propelled vehicle without depth: networks learn a Doppler log and are judged by it."""

import dataclasses
import html

import numpy as np
import pytest
from logs import SENTINEL, sailfish_columns

import learn
from factory.importing import import_logs
from factory.samples import write_csv
from learn.data.labels import LabelConfig
from learn.finishing import finish
from learn.networks.base import NetworkConfig
from learn.training.fit_config import FitConfig
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from twin.navigation.features import select_features
from twin.records.store import write_store

RUNS = ("20220701_0_0", "20220702_0_0")
SPEEDS = (1.4, 1.6)
"""[m/s] of each run"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Two runs at speeds of their own, the same in every sample."""
    folder = tmp_path_factory.mktemp("auv")
    for name, speed in zip(RUNS, SPEEDS, strict=True):
        columns = sailfish_columns()
        columns["vf"] = np.where(columns["vf"] == -SENTINEL, -SENTINEL, speed)
        write_csv(folder / f"{name}.csv", columns)
    dataset, report = import_logs("csv", [folder], mapping="sailfish")
    assert "measured_depth" not in report.channels
    return write_store(dataset, folder / "auv.zarr")


def config(store, **changes):
    base = FitConfig(
        store=str(store),
        features=select_features(("attitude", "gyroscope")),
        network=NetworkConfig(kind="mlp", hidden=6, layers=1),
        training=TrainingConfig(seconds=0.0, epochs=2, validations=2),
        labels=LabelConfig(source="dvl", known_current="0,0"),
        period=1.0,
    )
    return dataclasses.replace(base, **changes)


def test_the_page_of_a_run_says_that_it_learned_from_the_log(store, tmp_path):
    run = fit(config(store), tmp_path / "run")
    page = html.unescape(finish(run).report.read_text(encoding="utf-8"))
    assert "Labels and reference are the Doppler log's cleaned velocities, at" in page
    assert "Networks learned from the Doppler log, not from the truth" in page
    assert "Truth at" not in page
    card = (run.folder / "README.md").read_text(encoding="utf-8")
    assert "against the Doppler log's cleaned velocities" in card
    assert "hold a velocity through the water" not in card


def test_a_log_without_depth_is_evaluated_by_its_velocities(store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    run = learn.fit(
        store, folder=tmp_path / "run", features=("attitude", "gyroscope"), network="mlp",
        hidden=6, layers=1, epochs=1, members=1, period=1.0, labels="dvl", known_current="0,0",
    )  # fmt: skip
    figures = run.figures
    assert figures is not None
    assert figures["counts"]["samples_with_truth"] > 50
    assert figures["surge_mse"] < 4.0
    assert figures["sway_mse"] is not None
    assert figures["dr_ground_percent_mean"] is None  # without depth there is no path
