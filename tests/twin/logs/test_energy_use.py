"""Energy of a deployment: consumers found again in a log that was made of them; days left."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from logs import SHARED, stored

import twin
from factory.samples import Flight
from factory.samples.gliders import gps_columns, slocum_columns, write_slocum
from twin.__main__ import PROGRAM
from twin.logs import EnergyUse, endurance_of
from twin.logs.energy_timeline import DiveCharge, EnergyTimeline, NotCounted, settled
from twin.logs.energy_use import counted_energy, energy_used, second_half
from twin.records.logged import LogStore
from twin.records.store import write_store
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import load_vehicle

FLIGHT = Flight(dives=12, depth=100.0)
VOLTS = 15.0
HOTEL, SURFACE, PAYLOAD = 2.0, 3.0, 0.8
EFFICIENCY, LOSS, RETURN = 0.5, 2.0e6, 4.0e5
VACUUM_INHG = 8.0
COUNTER = "m_coulomb_amphr_total"


def used(time: np.ndarray, depth: np.ndarray, pump: np.ndarray, sampling: np.ndarray) -> np.ndarray:
    """[A h] of the consumers above, without the drives."""
    step = np.diff(time, prepend=time[0])
    vehicle = load_vehicle("slocum-200")
    middle = 0.5 * (depth + np.concatenate([depth[:1], depth[:-1]]))
    pressure = vehicle.reference_density * vehicle.gravity * middle + VACUUM_INHG * 3386.389
    moved = np.diff(pump, prepend=pump[0]) * 1e-6
    out, into = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
    joule = step * (HOTEL + SURFACE * (depth < 1.5) + PAYLOAD * sampling)
    joule = joule + out * (pressure / EFFICIENCY + LOSS) + into * RETURN
    return np.cumsum(joule) / VOLTS / 3600.0


@pytest.fixture(scope="module")
def columns():
    """Dives of different depths, the payload on in every second one."""
    table = slocum_columns(FLIGHT)
    dive = FLIGHT.state(table["time"])["dive"]
    for name in ("m_depth", "m_pressure"):
        table[name] = table[name] * (0.5 + 0.09 * np.minimum(dive * 5 % 12, 11))
    sampling = dive % 2 == 0
    warm = np.where(sampling, 8.0, np.nan)
    table |= {"sci_water_temp": warm, "sci_water_cond": np.where(sampling, 3.4, np.nan)}
    table[COUNTER] = 12.0 + used(
        table["time"], table["m_depth"], table["m_ballast_pumped"], sampling
    )
    table["m_battery"] = np.full(len(dive), VOLTS)
    table["m_vacuum"] = np.full(len(dive), VACUUM_INHG)
    return table


def store_of(folder: Path, columns: dict[str, np.ndarray], name: str = "log.zarr") -> Path:
    return stored(folder / name, "slocum", write_slocum(folder, FLIGHT, **columns))


@pytest.fixture(scope="module")
def store(columns, tmp_path_factory):
    return store_of(tmp_path_factory.mktemp("energy"), columns)


@pytest.fixture(scope="module")
def silent(columns, tmp_path_factory):
    """A store of a log that counts nothing."""
    table = {name: v for name, v in columns.items() if name not in (COUNTER, "m_battery")}
    return store_of(tmp_path_factory.mktemp("silent"), table)


@pytest.fixture(scope="module")
def found(store):
    return energy_used(store, "slocum-200")


def test_the_consumers_of_a_known_log_are_found_again(found):
    terms = {one.name: one for one in found.terms}
    for name, right in (
        ("hotel", HOTEL), ("surface", SURFACE), ("payload", PAYLOAD), ("pump", 1.0 / EFFICIENCY),
        ("pump loss", LOSS), ("pump return", RETURN),
    ):  # fmt: skip
        # the import bridges holes of two minutes in the payload, which looks on for longer
        rel = 0.08 if name == "payload" else 0.05
        assert terms[name].value == pytest.approx(right, rel=rel), name
        assert terms[name].deviation < 0.02 * right, name
    assert found.voltage == pytest.approx(VOLTS, rel=1e-6)
    assert sum(one.energy for one in found.terms) == pytest.approx(
        found.power * found.hours * 3600.0, rel=0.01
    )
    assert found.consumption.hull_vacuum == pytest.approx(VACUUM_INHG * 3386.389, rel=1e-4)
    assert found.consumption.pump_efficiency == pytest.approx(EFFICIENCY, rel=0.06)


def test_later_dives_are_foretold_by_what_they_do(store, found):
    """Each dive's charge; its hours alone say less, since depths and payload differ."""
    tried = second_half(store, load_vehicle("slocum-200"))
    assert tried is not None
    assert (tried.taught, len(tried.dives)) == (6, 6)
    errors = tried.errors()
    assert errors["model_per_dive"] < 0.02
    assert errors["per_hour_per_dive"] > 0.05
    mean = np.mean([one.measured for one in found.dives[:6]])
    assert tried.each == pytest.approx(mean, rel=0.01)


def test_the_time_between_two_dives_is_at_the_surface(store, tmp_path):
    """Also where the log has no phase at the first sample after it."""
    data = xr.open_zarr(store).load()
    data["measured_phase"][:, 0] = np.nan
    with LogStore(write_store(data, tmp_path / "log.zarr")) as logs:
        line = EnergyTimeline(logs, range(len(logs)), load_vehicle("slocum-200"))
    between = np.flatnonzero(np.diff(line.mission))
    waited = np.diff(line.time)[between]
    assert waited.min() > 60.0
    np.testing.assert_allclose(np.diff(line.done["surface"])[between], waited)


def test_a_counter_that_starts_again_is_left_out_and_counted(columns, tmp_path):
    charge = columns[COUNTER].copy()
    half = len(charge) // 2
    charge[half:] -= charge[half]
    found = energy_used(store_of(tmp_path, {**columns, COUNTER: charge}), "slocum-200")
    assert found.resets == 1
    assert found.terms[0].value == pytest.approx(HOTEL, rel=0.06)


def test_counters_of_two_vehicles_are_not_one(columns, tmp_path):
    """The second begins within a minute of the first one's end, at another count."""
    files = []
    for number, name in enumerate(("unit1", "unit2")):
        moved = number * float(np.ptp(columns["time"]) + 30.0)
        counted = {**columns, COUNTER: columns[COUNTER] + 50.0 * number}
        counted["time"] = counted["time"] + moved
        gps = gps_columns(FLIGHT)
        gps["time"] += moved
        files += write_slocum(tmp_path, FLIGHT, name, gps=gps, **counted)
    path = stored(tmp_path / "both.zarr", "slocum", files)
    found = energy_used(path, "slocum-200")
    assert found.terms[0].value == pytest.approx(HOTEL, rel=0.06)
    newest = counted_energy(path, "slocum-200", newest=True)
    assert newest is not None
    assert len(newest.dives) * 2 == len(found.dives)


def test_a_counter_read_rarely_is_enough(columns, tmp_path):
    """A reading in ten minutes: an equation goes from one to the next."""
    seldom = np.arange(len(columns["time"])) % 150 == 0
    charge = np.where(seldom, columns[COUNTER], np.nan)
    found = energy_used(store_of(tmp_path, {**columns, COUNTER: charge}), "slocum-200")
    assert found.hours / found.equations > 1 / 6
    assert found.terms[0].value == pytest.approx(HOTEL, rel=0.2)


def test_a_log_that_does_not_count_says_so(silent, capsys):
    with pytest.raises(NotCounted, match="lacks measured_charge and measured_voltage"):
        energy_used(silent)
    assert counted_energy(silent, "slocum-200") is None
    assert PROGRAM.main(["energy", str(silent)]) == 2
    assert COUNTER in capsys.readouterr().err


def test_noise_of_an_encoder_is_no_move():
    rng = np.random.default_rng(1)
    moves = np.repeat([-200.0, 200.0, -200.0], 500)
    noisy = moves + rng.normal(0.0, 0.3, len(moves))
    followed = settled(noisy)
    assert np.abs(np.diff(noisy)).sum() > 1200.0
    assert np.abs(np.diff(followed)).sum() == pytest.approx(800.0, rel=0.02)


def test_the_command_tells_and_writes_a_vehicle_that_takes_as_much(store, tmp_path, capsys):
    out = tmp_path / "mine.xml"
    words = ["energy", str(store), "--vehicle", "slocum-200", "--out", str(out)]
    assert PROGRAM.main([*words, "--energy-left-kwh", "1.2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["days_left"] == pytest.approx(1200.0 / told["power_w"] / 24.0)
    assert told["later_dives"]["model_per_dive"] < 0.02
    losses = Consumption.of(load_vehicle(out))
    assert losses.hotel_power == pytest.approx(told["terms"]["hotel"]["value"])
    assert losses.pump_loss == pytest.approx(told["terms"]["pump loss"]["value"])
    flown = twin.simulate(vehicle=str(out), duration=600.0)
    afloat = 600.0 * float(np.mean(flown["true_depth"] < 1.5))
    hotel = 600.0 * (losses.hotel_power + losses.payload_power) + afloat * losses.surface_power
    assert flown["true_energy_hotel"][-1] == pytest.approx(hotel, rel=0.02)
    assert PROGRAM.main(words) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("folder", "cache", "dives"),
    [("slocum_barnacle_2022", None, 5), ("slocum_electa_2022", "cache", 7)],
)
def test_charge_of_later_dives_of_real_gliders(folder, cache, dives, tmp_path):
    """Within a tenth, better than by the hour; electa's thruster runs in the later ones alone."""
    place = SHARED / folder
    if not place.is_dir():
        pytest.skip("the shared real logs are absent")
    pytest.importorskip("dbdreader")
    files = sorted([*(place / "raw").glob("*.dbd"), *(place / "raw").glob("*.ebd")])
    store = stored(tmp_path / "log.zarr", "slocum", files, cache=place / (cache or "raw"))
    tried = second_half(store, load_vehicle("slocum-1000"))
    assert tried is not None
    errors = tried.errors()
    assert len(tried.dives) == dives
    assert errors["model_per_dive"] < 0.10
    assert errors["model_per_dive"] < 0.5 * errors["per_hour_per_dive"]
    assert errors["model_per_dive"] < 0.5 * errors["each_per_dive"]


def test_a_flight_tells_power_and_days_left(store, silent, found, tmp_path, capsys):
    words = ["--vehicle", "slocum-200", "--estimator", "steady", "--overwrite", "--json"]
    words += ["--out", str(tmp_path / "flight.nc")]
    left = ["--energy-left-kwh", "1.2"]
    for more, days in ((left, pytest.approx(1200.0 / found.power / 24.0)), ([], None)):
        assert PROGRAM.main(["flight", str(store), *words, *more]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["power_w"] == pytest.approx(found.power)
        assert told["days_left"] == days
    assert PROGRAM.main(["flight", str(store), *words, "--energy-left-kwh", "-1"]) == 2
    assert "--energy-left-kwh -1 must be above 0" in capsys.readouterr().err
    assert PROGRAM.main(["flight", str(silent), *words, *left]) == 2
    assert "lacks measured_charge and measured_voltage" in capsys.readouterr().err


def test_a_forecast_takes_the_power_that_the_log_has_counted(store, found, capsys):
    place = ["--goto", "49.6,-57.9", "--vehicle", "slocum-200", "--members", "10", "--hours", "1"]
    words = ["forecast", *place, "--json", "--energy-left-kwh", "1.2"]
    told = []
    for more in (["--logs", str(store)], ["--from", "49.55,-57.97,2026-11-24T12:00:00"]):
        assert PROGRAM.main([*words, *more]) == 0
        told.append(json.loads(capsys.readouterr().out))
    counted, shipped = told
    mine = found.consumption
    kept = Consumption.of(load_vehicle("slocum-200"))
    steady = [one.hotel_power + one.payload_power for one in (mine, kept)]
    assert steady[0] - steady[1] > 0.1  # the log's vehicle takes more than the shipped one
    assert counted["power_W"] - shipped["power_W"] > 0.5 * (steady[0] - steady[1])
    assert counted["days_left"] == pytest.approx(1200.0 / counted["power_W"] / 24.0)


def test_an_identified_vehicle_takes_what_its_log_has_counted(store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.identify.fit.BAD", np.inf)  # this log's flight is kinematic
    out = tmp_path / "mine.xml"
    words = ["identify", str(store), "--vehicle", "slocum-200", "--out", str(out)]
    assert PROGRAM.main([*words, "--no-handling", "--parameters", "drag"]) == 0
    losses = Consumption.of(load_vehicle(out))
    assert losses.hotel_power == pytest.approx(HOTEL, rel=0.05)
    assert losses.surface_power == pytest.approx(SURFACE, rel=0.05)
    assert losses.payload_power == pytest.approx(PAYLOAD, rel=0.08)
    assert losses.pump_efficiency == pytest.approx(EFFICIENCY, rel=0.06)
    assert losses.hull_vacuum == pytest.approx(VACUUM_INHG * 3386.389, rel=1e-4)


def test_a_solver_that_multiplies_by_infinity_is_not_heard(store, found, monkeypatch):
    """As SciPy's does where a gradient is zero along an endless step; the answer stands."""
    import scipy.optimize

    solve = scipy.optimize.lsq_linear

    def with_endless_step(*given: object, **more: object) -> object:
        assert np.isnan(np.zeros(1) * np.array([np.inf]))
        return solve(*given, **more)

    monkeypatch.setattr(scipy.optimize, "lsq_linear", with_endless_step)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert energy_used(store, "slocum-200").terms == found.terms


# --- days left by the dives so far ----------------------------------------------------------------


VOLTAGE, HOURS = 14.0, 4.0


def dives_of(power: np.ndarray, afloat: float = 0.0) -> EnergyUse:
    """Dives of four hours; `afloat` more hours at the same power in all."""
    charge = power * HOURS / VOLTAGE
    vehicle = load_vehicle("slocum-200")
    return EnergyUse(
        vehicle=vehicle, terms=(), consumption=Consumption.of(vehicle), voltage=VOLTAGE,
        dives=tuple(
            DiveCharge(mission=k, hours=HOURS, measured=float(one), modelled=np.nan)
            for k, one in enumerate(charge)
        ),
        hours=HOURS * len(power) + afloat, equations=0, resets=0,
        charge=float(charge.sum() * (1.0 + afloat / HOURS / len(power))),
    )  # fmt: skip


def test_an_even_power_is_the_energy_over_it():
    found = endurance_of(dives_of(np.full(20, 3.0), afloat=8.0), 3.6)
    assert found is not None
    assert found.days == pytest.approx(50.0, rel=1e-3)
    low, high = found.interval()
    assert 0.9 * 50.0 < low < 50.0 < high < 1.1 * 50.0
    assert np.median(found.days_drawn(added=3.0)) == pytest.approx(25.0, rel=0.02)


def test_more_dives_promise_more():
    rng = np.random.default_rng(0)
    width: dict[int, list[float]] = {5: [], 50: []}
    for count in 20 * [5, 50]:
        found = endurance_of(dives_of(3.0 + 0.2 * rng.standard_normal(count)), 1.0)
        assert found is not None
        low, high = found.interval()
        width[count].append((high - low) / found.days)
    assert np.mean(width[50]) < 0.6 * np.mean(width[5])


def test_a_power_that_grows_is_expected_to_grow_on():
    power = np.linspace(3.0, 4.0, 100) + 0.02 * np.random.default_rng(1).standard_normal(100)
    found = endurance_of(dives_of(power), 1.0)
    assert found is not None
    assert found.power > 4.0 > dives_of(power).power + 0.4
    left = 1e3 / 3.5 / HOURS  # dives; their mean is on the line after half of them
    assert found.power == pytest.approx(4.0 + 0.5 * left / 99.0, abs=0.05)


def test_a_plan_that_changed_counts_more_than_what_was_before():
    power = np.r_[np.full(30, 2.0), np.full(30, 3.0)]
    power += 0.05 * np.random.default_rng(2).standard_normal(60)
    found = endurance_of(dives_of(power), 1.0)
    assert found is not None
    assert found.power == pytest.approx(3.0, abs=0.15)


def test_two_dives_tell_nothing_and_no_energy_no_days():
    assert endurance_of(dives_of(np.full(2, 3.0)), 1.0) is None
    found = endurance_of(dives_of(np.full(5, 3.0)), -0.1)
    assert found is not None
    assert found.days == 0.0
    assert found.interval() == (0.0, 0.0)
