"""What is judged: test dives, plans that no balance holds, few channels, the water, lags."""

import dataclasses
import math

import numpy as np
import pytest
from logs import SHARED, stored

import twin
from glider_twin_ops.health.channels import NAMES, NOISE, PLACE
from glider_twin_ops.health.deployment_dives import ballasted, rate_steps, told_by, values_of
from glider_twin_ops.health.dive_channels import (
    DiveSignals,
    channels_of,
    flight_model,
    strokes_of,
)
from glider_twin_ops.health.signatures import (
    dive_scenario,
    held,
    signatures_of,
    told,
    usual_dive,
)
from twin.identify import load_calibration
from twin.logs import estimate_flight
from twin.mission import track_to_follow
from twin.physics import Lane, flown_abreast
from twin.records import LogStore

SLOCUM = twin.load_vehicle("slocum-200")


def narrow(most):
    """A Slocum whose battery moves less: a climb of 35 degrees is beyond it."""
    slide = SLOCUM.steered("pitch").name
    return SLOCUM.replace(**{slide: {"low": -most, "high": most}})


@pytest.mark.parametrize(("pitch", "net"), [(40.0, 0.2), (26.0, 0.002), (6.0, 0.24)])
def test_a_plan_beyond_the_balance_gives_way_to_the_nearest_that_holds(pitch, net):
    vehicle = narrow(0.02)
    asked = dataclasses.replace(
        usual_dive(vehicle), pitch=pitch, climb_pitch=pitch, net_mass=net, climb_net_mass=net
    )
    found = held(vehicle, asked)
    for way, sign in (("", 1.0), ("climb_", -1.0)):
        angle, mass = getattr(found, f"{way}pitch"), getattr(found, f"{way}net_mass")
        track_to_follow(vehicle, "dive", "pitch_deg", -sign * angle, sign * mass, None)
        assert 0.0 < mass <= vehicle.net_mass_range[1] + 1e-12
    assert found.depth == asked.depth
    usual = usual_dive(SLOCUM)
    assert held(SLOCUM, usual) == usual


def test_a_vehicle_that_cannot_climb_steeply_has_signatures_and_says_in_which_dive(slocum, noise):
    vehicle = narrow(0.02)
    dive = dataclasses.replace(usual_dive(vehicle, depth=60.0), pitch=40.0, climb_pitch=40.0)
    found = signatures_of(vehicle, dive)
    assert found.dive.pitch < 40.0
    shown = {h.kind: h.signature for h in found.hypotheses}
    assert shown["attached"][PLACE["rate_climb"]] < -0.1
    one = slocum.judge(noise(), dive=dive, vehicle=vehicle)
    assert any("nearest dive that vehicle" in said for said in one.remarks)
    assert one.judged


def test_a_vehicle_that_holds_no_dive_is_told_and_not_refused(slocum, noise, monkeypatch):
    from glider_twin_ops.health import signatures

    monkeypatch.setattr(signatures, "held", lambda vehicle, dive: None)
    one = slocum.judge(noise(), dive=usual_dive(SLOCUM, depth=77.0))
    assert any("holds no dive like the log's" in said for said in one.remarks)
    assert not one.alarm


def test_fewer_than_five_channels_give_levels_and_no_alarm(slocum, noise):
    seen = np.full_like(noise(), math.nan)
    few = [PLACE[name] for name in ("air", "surface_depth", "pump_rate", "rate_dive")]
    seen[:, few] = noise()[:, few]
    seen[12:, PLACE["surface_depth"]] += 3.0  # 40 times its noise
    one = slocum.judge(seen)
    assert (one.alarm, one.judged, one.rang) == (False, False, ())
    assert np.isfinite(one.levels.level[:, few]).all()
    said = one.remarks[-1]
    assert said.startswith("The log has 4 channels (rate_dive, pump_rate, air, surface_depth)")
    shown, hidden = said.split("In them would show ")[1].split("; ")
    assert "pressure_drift" in shown
    assert "altimeter_blind" in hidden
    assert "4 of 22 channels are too few to judge" in one.verdict()
    seen[:, PLACE["roll_dive"]] = noise()[:, PLACE["roll_dive"]]
    assert slocum.judge(seen).alarm  # the fifth


def test_drag_alone_is_named_as_drag_and_a_wing_by_its_roll(slocum, noise):
    """An attached object may hang on the axis: then only the rates change."""
    rates = [PLACE[name] for name in ("rate_dive", "rate_climb")]
    seen = noise()
    seen[12:, rates] -= 0.12
    one = slocum.judge(seen)
    assert one.alarm
    assert {"attached", "fouling"} & {one.kind, *one.kinds[0].also}
    assert one.kind != "wing_lost"
    wing = next(h for h in slocum.signatures.hypotheses if getattr(h.fault, "side", "") == "port")
    seen = noise()
    seen[12:] += np.nan_to_num(wing.signature)
    one = slocum.judge(seen)
    assert (one.kind, one.kinds[0].also) == ("wing_lost", ())


def test_a_signature_that_is_off_by_a_quarter_in_each_channel_is_still_called(slocum, noise):
    for seed in range(3):
        scales = 1.0 + 0.25 * np.random.default_rng(seed).standard_normal(len(NAMES))
        for kind in ("attached", "pump_weak", "pitch_slips"):
            fault, seen = slocum.fault(kind), noise(seed)
            seen[10:] += scales * np.nan_to_num(fault.signature) * fault.scale
            one = slocum.judge(seen)
            assert kind in (one.kind, *one.kinds[0].also)


def turning(count=36, speed=0.3):
    """Ways on legs of three headings, and currents of the channels that are zero."""
    angle = np.deg2rad([20.0, 140.0, 260.0])[np.arange(count) // 4 % 3]
    return speed * np.column_stack([np.cos(angle), np.sin(angle)])


def read_by_a_turned_compass(noise, degrees, begun):
    """Channels and ways of a vehicle whose compass is turned from a dive on."""
    ways, seen = turning(), noise(2, 36)
    turn = np.where(np.arange(36) >= begun, math.radians(degrees), 0.0)
    read = np.column_stack([
        np.cos(turn) * ways[:, 0] - np.sin(turn) * ways[:, 1],
        np.sin(turn) * ways[:, 0] + np.cos(turn) * ways[:, 1],
    ])  # fmt: skip
    seen[:, [PLACE["current_north"], PLACE["current_east"]]] += ways - read
    return seen, read


def test_a_compass_that_is_turned_as_a_whole_is_named_by_three_headings(slocum, noise):
    seen, read = read_by_a_turned_compass(noise, 15.0, 12)
    one = slocum.judge(seen, ways=read)
    assert one.kind == "compass_turned"
    assert one.kinds[0].size == pytest.approx(15.0, abs=5.0)
    seen, read = read_by_a_turned_compass(noise, 8.0, 0)
    one = slocum.judge(seen, ways=read)
    assert not one.alarm
    off, deviation = one.compass_turned
    assert abs(off - 8.0) < 2.5 * deviation + 1.0
    assert off > 3.0 * deviation
    assert any("degrees off as a whole" in said for said in one.remarks)
    straight = np.tile(read[:1], (36, 1))
    assert slocum.judge(seen, ways=straight).compass_turned is None


def test_a_small_net_mass_and_an_unknown_density_make_rates_unsure():
    def dive(volume, depth=100.0):
        z = np.concatenate([np.linspace(0.0, depth, 200), np.linspace(depth, 0.0, 200)])
        down = np.arange(400) < 200
        signals = {
            "measured_depth": z, "measured_pitch": np.where(down, -26.0, 26.0),
            "measured_pump": np.where(down, -200.0, volume),
        }  # fmt: skip
        return DiveSignals(period=4.0, signals=signals)

    steps = rate_steps([dive(200.0), dive(200.0), dive(50.0)], SLOCUM, None)
    assert not steps["rate_dive"].any()
    assert steps["rate_climb"][1] == 0.0
    # 30 g of 50 g and of 200 g, half of each
    assert steps["rate_climb"][2] == pytest.approx(0.5 * 0.03 * (1 / 0.05 - 1 / 0.2), rel=0.1)
    blind = rate_steps([dive(200.0)] * 3, SLOCUM, np.array([0.0, 0.0, 5.0]))["rate_dive"]
    assert blind[1] > 0.005
    assert blind[2] > 10.0 * blind[1]  # another depth, another water


def flown(net_mass):
    """Log of a dive by a Slocum that is as its file says."""
    asked = dataclasses.replace(usual_dive(SLOCUM), net_mass=net_mass, climb_net_mass=net_mass)
    scenario = dive_scenario(SLOCUM, held(SLOCUM, asked))
    ((_, found),) = flown_abreast([Lane(scenario, until_flown=True)])
    return told(scenario, found)


def test_a_weight_that_the_file_lacks_moves_no_rate():
    """70 g move the rates by 0.1 and more, and another volume moves them again."""
    dives = [flown(0.24)] * 3 + [flown(0.14)] * 3
    rates = [PLACE["rate_dive"], PLACE["rate_climb"]]
    right = values_of(dives, flight_model(SLOCUM))[:, rates]
    density = SLOCUM.reference_density
    for other in (density - 1.4, density + 1.4):
        calibration = flight_model(SLOCUM.replace(reference_density=other))
        assert np.abs(values_of(dives, calibration)[:, rates] - right).min() > 0.08
        found = ballasted(dives, calibration)
        assert found.vehicle.reference_density == pytest.approx(density, abs=0.2)
        assert values_of(dives, found)[:, rates] == pytest.approx(right, abs=0.02)
    # drag moves dives and climbs alike, and is no weight
    calibration = flight_model(SLOCUM)
    slow = calibration.with_vehicle(law=SLOCUM.law.with_drag(1.3))
    assert ballasted(dives, slow).vehicle.reference_density == pytest.approx(density, abs=0.2)


def test_where_the_ctd_is_off_what_needs_the_water_is_not_judged():
    z = np.concatenate([np.linspace(0.0, 100.0, 200), np.linspace(100.0, 0.0, 200)])
    down = np.arange(400) < 200
    signals = {
        "measured_depth": z, "measured_pitch": np.where(down, -26.0, 26.0),
        "measured_pump": np.where(down, -200.0, 200.0), "measured_vacuum": np.full(400, 2.5e4),
        "measured_density": np.full(400, 1026.0), "measured_temperature": np.full(400, 10.0),
    }  # fmt: skip
    calibration = flight_model(SLOCUM)

    def channels(**changes):
        every = signals | {f"measured_{name}": values for name, values in changes.items()}
        found = channels_of(DiveSignals(period=4.0, signals=every), calibration)
        return found[[PLACE["rate_dive"], PLACE["rate_climb"], PLACE["air"]]]

    nothing = np.full(400, math.nan)
    assert np.isfinite(channels()).all()
    assert np.isnan(channels(density=nothing, temperature=nothing)).all()
    # off in climbs: dives are judged
    down_only = np.where(down, 1026.0, math.nan)
    assert np.isfinite(channels(density=down_only)).tolist() == [True, False, True]


def test_a_lag_needs_full_rate_and_halves_that_agree():
    def lag(period, waves):
        fall = np.arange(1.0, 120.0, 0.15 * period)
        depth = np.concatenate([fall, fall[::-1]])
        rate = np.gradient(depth, period)
        climbing = np.arange(len(depth)) >= len(fall)
        moved = depth + waves * (climbing & (depth > 60.0))  # water that rose between the two
        warm = 10.0 - 5.0 * np.tanh((moved - 15.0 * rate - 60.0) / 25.0)
        signals = {"measured_depth": depth, "measured_temperature": warm}
        return channels_of(DiveSignals(period=period, signals=signals), None)[
            PLACE["temperature_lag"]
        ]

    assert lag(4.0, 0.0) == pytest.approx(15.0, rel=0.15)
    assert math.isnan(lag(60.0, 0.0))
    assert math.isnan(lag(4.0, -12.0))


def test_a_pump_without_any_value_has_no_stroke():
    found = strokes_of(np.full(9, math.nan), 4.0)
    assert not found.out.any()


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the shared real logs")
def test_health_says_of_a_real_log_what_the_flight_model_says(tmp_path):
    pytest.importorskip("pyarrow")
    store = stored(tmp_path / "real.zarr", "slocum", [SHARED / "slocum_unit334_2023"])
    with LogStore(store) as logs:
        found = told_by(logs, "unit334", SLOCUM)
    heavier = SLOCUM.mass / (SLOCUM.mass - found["ballast"])
    own = SLOCUM.replace(reference_density=SLOCUM.reference_density * heavier)
    flight = estimate_flight(store, own, thermal_lag=False)
    calibration = load_calibration(own)
    assert calibration == flight.calibration
    compared = 0
    for one, values in zip(flight.missions, found["values"], strict=True):
        dive = one.dive
        for word, phase in (("dive", dive.descending), ("climb", dive.ascending)):
            rate = values[PLACE[f"rate_{word}"]]
            used = phase & np.isfinite(dive.water_up)
            if np.isfinite(rate):
                up = dive.water_up[used].sum()
                log = np.gradient(dive.depth, flight.store.period)[used].sum()
                assert rate == pytest.approx(-up / log, abs=0.02)
                compared += 1
    assert compared > 40
    assert NOISE[PLACE["rate_dive"]] >= 0.02 - 1e-12
