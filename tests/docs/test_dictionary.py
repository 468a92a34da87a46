"""The data dictionary: every variable that stores, logs and flights hold is on its page."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest
import xarray as xr
from examples import needs_docs, script
from simulated_logs import simulated_log

import factory
import twin
from factory.importing.dives.dive_rows import NUMBERS
from factory.importing.payload import KNOWN
from twin.logs import write_flight
from twin.records.schema import SIGNALS
from twin.vehicle.presets import shipped_files
from twin.vehicle.vehicle import load_vehicle

pytestmark = needs_docs

ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def dictionary() -> ModuleType:
    """scripts/docs_dictionary.py"""
    return script("docs_dictionary")


@pytest.fixture(scope="module")
def page(dictionary: ModuleType) -> str:
    """Markdown of the page."""
    return str(dictionary.dictionary_page())


@pytest.fixture(scope="module")
def rows(page: str) -> dict[str, list[str]]:
    """The rows of each variable, without its name."""
    found: dict[str, list[str]] = {}
    for name, rest in ROW.findall(page):
        found.setdefault(name, []).append(rest)
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of logs."""
    return simulated_log(tmp_path_factory.mktemp("log"), load_vehicle("slocum-200"))


def check(rows: dict[str, list[str]], dataset: xr.Dataset) -> None:
    """Every variable of the dataset has a row with its unit and its long name."""
    wrong = []
    for name, variable in dataset.variables.items():
        said = {**variable.encoding, **variable.attrs}  # xarray has units of moments there
        words = [str(said.get("long_name"))]
        if "units" in said:
            moment = " since " in said["units"]  # xarray may choose other units for these
            words.append(" since 1970-01-01" if moment else f"| {said['units']} |")
        elif "flag_meanings" in said:
            words.append("| flag |")
        texts = [f"| {text} |".replace("\\", "") for text in rows.get(str(name), [])]
        if not any(all(word in text for word in words) for text in texts):
            wrong.append((name, words, texts))
    assert not wrong
    assert len(dataset.variables) > 20


@pytest.mark.parametrize("vehicle", ["glider", "tethys"])
def test_every_variable_of_a_generated_store(
    rows: dict[str, list[str]], tmp_path: Path, vehicle: str
) -> None:
    report = factory.generate(
        tmp_path / "field.zarr", preset="field", vehicle=vehicle, hours=0.3, workers=1
    )
    with xr.open_zarr(tmp_path / "field.zarr") as dataset:
        assert any(str(name).startswith("sensor_") for name in dataset), report
        check(rows, dataset)


def test_every_variable_of_a_simulated_mission(rows: dict[str, list[str]], tmp_path: Path) -> None:
    run = twin.simulate(vehicle="tethys", duration=60.0, sensors="field", floor="depth:60")
    with xr.open_zarr(run.save(tmp_path / "run.zarr")) as dataset:
        assert {"measured_propeller", "true_energy_elevator", "simulation_state"} <= set(dataset)
        check(rows, dataset)


def test_every_variable_of_a_log_and_of_its_flight(
    rows: dict[str, list[str]], log: Path, tmp_path: Path
) -> None:
    with xr.open_zarr(log) as dataset:
        assert {"end_latitude", "displacement_north", "position_method"} <= set(dataset)
        check(rows, dataset)
    assert {one.signal for one in KNOWN} | set(NUMBERS) <= set(rows)
    write_flight(twin.estimate_flight(log), tmp_path / "flight.nc")
    with xr.open_dataset(tmp_path / "flight.nc") as dataset:
        check(rows, dataset)


def test_every_part_of_every_shipped_vehicle(rows: dict[str, list[str]], page: str) -> None:
    for name in shipped_files():
        for part in load_vehicle(name).part_names:
            wanted = {f"{of}_{part}" for of in ("true", "commanded", "measured", "true_energy")}
            assert wanted <= set(rows), name
    for pattern in ("true_PART", "commanded_PART", "measured_PART", "true_energy_PART"):
        assert f"`{pattern}`" in page


def test_signals_have_limits_frames_and_presence(
    dictionary: ModuleType, rows: dict[str, list[str]], page: str
) -> None:
    for entry in SIGNALS:
        assert any(f"| {dictionary.limits(entry.name)} |" in row for row in rows[entry.name])
    assert re.search(r"`true_surge` .* \| body \|", page)
    assert re.search(r"`true_current_north` .* \| NED \|", page)
    assert re.search(r"`measured_phase` .* \| 0 to 3 \| logs \|", page)
    assert re.search(r"`true_sway` .* \| ±10; simulated ±5 \| all \|", page)
    assert re.search(r"`measured_gps_east` .* \| all; may be NaN \|", page)


def test_parameters_say_whose_they_are(rows: dict[str, list[str]]) -> None:
    assert any(row.endswith("| with a propeller") for row in rows["floor_depth_m"])
    assert any(row.endswith("| gliders") for row in rows["water_bottom_below_m"])
    assert any(row.endswith("| all") for row in rows["current_speed"])
