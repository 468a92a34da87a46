"""Answers for drag, compass and pump of a log, and the page that shows them."""

import dataclasses
import json
import math

import numpy as np
import pytest
from browser import Browser, needs_browser

import twin
from factory.importing import import_logs
from factory.samples import Flight
from factory.samples.gliders import slocum_columns, write_slocum
from glider_twin_ops.health import CHANNELS, answer_for
from glider_twin_ops.health.channels import NAMES
from glider_twin_ops.pages import write_health
from twin.__main__ import PROGRAM
from twin.records import write_store

RATE = 12.0
"""[cm3/s] of the imaginary pump"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Nine dives of an imaginary Slocum that pumps at a known rate."""
    folder = tmp_path_factory.mktemp("logs")
    flight = Flight(dives=9, heading=60.0)
    pump = slocum_columns(flight)["m_ballast_pumped"].copy()
    for k in range(1, len(pump)):
        pump[k] = pump[k - 1] + np.clip(pump[k] - pump[k - 1], -RATE * 4.0, RATE * 4.0)
    files = write_slocum(folder, flight, m_ballast_pumped=pump)
    return write_store(import_logs("slocum", files)[0], folder / "real.zarr")


@pytest.fixture(scope="module")
def said(store):
    return answer_for(store, "unit1", twin.load_vehicle("slocum-200"))


def test_drag_is_told_over_the_dives_with_its_change(said):
    assert len(said.drag["value"]) == len(said.drag["days"]) == len(said.dives) == 9
    assert abs(said.drag["change"]) < 3.0 * said.drag["change_deviation"] + 0.01
    assert said.drag["deviation"][-1] < said.drag["deviation"][0]


def test_a_pump_is_told_by_depth(said):
    for one in said.pump:
        assert one["rate_cm3_s"] == pytest.approx(RATE, rel=0.15)
        assert one["from_m"] < one["to_m"] <= 100.0


def test_what_a_log_does_not_tell_says_why(said):
    # one heading says nothing of another's deviation
    assert said.compass is None
    assert said.energy is None
    assert "headings" in said.lacking["compass"]
    assert "measured_charge" in said.lacking["energy"]
    json.dumps(said.describe())


def test_the_command_answers_by_json(store, capsys):
    assert PROGRAM.main(["health", str(store), "--vehicle", "slocum-200", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)["deployments"]
    assert one["alarm"] is False
    assert (one["judged"], one["otherwise"]) == (one["dives"] >= 7, None)
    assert {"rang", "remarks", "drag", "compass", "pump", "energy", "unanswered"} <= set(one)


def test_a_vehicle_of_another_kind_than_the_log_is_warned_of(store, capsys, monkeypatch):
    monkeypatch.setattr("twin.identify.logged_missions._kind", lambda _: "seaglider")
    assert PROGRAM.main(["health", str(store), "--vehicle", "slocum-200"]) == 0
    assert "is of another kind" in capsys.readouterr().err


@pytest.fixture(scope="module")
def page(tmp_path_factory, said, slocum, noise):
    fault = slocum.fault("attached")
    values = noise(1, 20)
    values[12:] += np.nan_to_num(fault.signature) * fault.scale
    values[:, NAMES.index("lock")] = math.nan
    time = 1.7e9 + 10_800.0 * np.arange(20)
    one = slocum.judge(values, name="unit1", numbers=range(20), time=time)
    headings = [
        {"heading_deg": 45.0 * k, "deviation_deg": 1.0, "standard_deviation_deg": 1.0}
        for k in range(8)
    ]
    compass = {"iron_deg": 5.0, "iron_deviation_deg": 1.5, "largest_at_deg": 60.0,
               "by_heading": headings}  # fmt: skip
    folder = tmp_path_factory.mktemp("page") / "health"
    said = dataclasses.replace(said, compass=compass)
    return one, write_health(folder, [one], "twin health real.zarr", {"unit1": said})


def test_the_page_says_of_each_kind_what_when_how_sure_and_what_to_do(page):
    one, path = page
    assert one.describe()["find_out"] == one.kinds[0].find_out
    text = path.read_text()
    assert text.count("<details") == len(one.kinds)
    assert text.count("<details open>") == 1
    opened = text.split("<details open>")[1].split("</details>")[0]
    first = one.kinds[0]
    for words in (first.says, first.find_out, first.otherwise, "dives to look at", "+-"):
        assert words in opened
    told = [c.name for c, column in zip(CHANNELS, one.values.T, strict=True)
            if np.isfinite(column).any()]  # fmt: skip
    pictures = {file.stem for file in path.parent.glob("*.png")}
    wanted = {f"unit1-{name}" for name in (*told, "evidence", "drag", "neutral_density")}
    assert pictures == wanted
    assert "iron of 5.0 +- 1.5 degree" in text


@needs_browser
def test_the_page_fits_a_phone_in_light_and_dark(page):
    with Browser(390, 800) as browser:
        for scheme in ("light", "dark"):
            browser.prefer(prefers_color_scheme=scheme)
            browser.open(page[1])
            assert browser.run("document.documentElement.scrollWidth") <= 390
        assert browser.problems == []
