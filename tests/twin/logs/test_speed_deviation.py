"""Standard deviations of speed and angle of attack, of gliders that no file describes."""

import identify_logs as simulated
import numpy as np
import pytest

from twin.errors import VehicleError
from twin.identify import choose, identify, load_calibration, load_logs, motion_of, write_vehicle
from twin.identify.answer import provenance_of
from twin.identify.speed import steady_parts
from twin.logs.flight_estimator import FlightModel

NOMINAL = load_calibration("glider")
SPREAD = ("lift_ratio", "induced_ratio", "pitch_offset", "pitch_scale")
GLIDERS, PITCHES = 12, (28.0, 32.0)


def wrong(rng):
    """A glider whose trim, drag, polar and pitch sensor are as far off as is known beforehand."""
    made = NOMINAL
    for p in choose(["neutral_density", "drag", *SPREAD]):
        sizes = 1.0 if p.name in SPREAD else p.held / p.spread
        made = p.at(made, p.get(made), rng.normal() * sizes)
    return made


@pytest.fixture(scope="module")
def fits(tmp_path_factory):
    """Flights in MuJoCo with field sensors and internal waves, and their identifications."""
    made, folder = [], tmp_path_factory.mktemp("wrong")
    for seed in range(GLIDERS):
        true = wrong(np.random.default_rng(seed))
        run = simulated.flown(true.vehicle, seed, yos=1, max_depth=100.0, pitch=PITCHES)
        pitch = run.signals["measured_pitch"]
        run.signals["measured_pitch"] = (pitch - np.degrees(true.pitch_offset)) / true.pitch_scale
        store = simulated.stored(folder / f"{seed}.zarr", [run])
        (log,) = load_logs(store)
        made.append((run, log, identify([log], NOMINAL, fixes=False), store))
    return made


def test_speeds_are_as_wrong_as_their_deviations_say(fits):
    """60 such gliders: RMS 0.94 and 0.97 of speed, 1.13 and 1.11 of the angle (dive, climb)."""
    z = []
    for run, log, found, _ in fits:
        motion = motion_of(log, found.calibration)
        speed = np.sqrt(sum(run[f"true_{axis}"] ** 2 for axis in ("surge", "sway", "heave")))
        attack = np.arctan2(run["true_heave"], run["true_surge"])
        missed = motion.speed - speed, motion.angle_of_attack - attack
        steady = log.use & steady_parts(log)
        for side in (steady & (log.depth_rate > 0.0), steady & (log.depth_rate < 0.0)):
            off = FlightModel().errors(log, found.calibration)
            z.append([
                m[side].mean() / np.linalg.norm(e[:, side].mean(axis=1))
                for m, e in zip(missed, off, strict=True)
            ])  # fmt: skip
    size = np.sqrt(np.mean(np.square(z), axis=0))
    assert (size > 0.6).all()  # the 0.1 and 99.9 % points of 12 normal numbers: 0.43 and 1.66
    assert (size < 1.6).all()


def test_an_identified_file_has_the_errors_of_its_fit(fits, tmp_path):
    _, log, found, store = fits[0]
    path = write_vehicle(found.calibration, tmp_path / "a.xml", provenance_of(found, store))
    read = load_calibration(path)
    steady = log.use & steady_parts(log) & (np.arange(len(log.depth)) > 60)  # after the plunge
    both = [FlightModel().errors(log, one) for one in (found.calibration, read)]
    for k in range(2):
        size = [np.linalg.norm(errors[k][:, steady], axis=0) for errors in both]
        np.testing.assert_allclose(*size, rtol=1e-3)
    # an unidentified vehicle, with trim and drag of their usual errors, 0.5 kg/m3 and 20 %
    (usual, _), (own, _) = (FlightModel().errors(log, c) for c in (NOMINAL, read))
    assert np.linalg.norm(usual[:, log.use]) > 1.2 * np.linalg.norm(own[:, log.use])
    text = path.read_text()
    at = text.rindex(old := '"lift_ratio": [')
    path.write_text(f"{text[:at]}{old}0.0, {text[at + len(old) :]}")
    with pytest.raises(VehicleError, match=r"'flight'.*identify the vehicle again"):
        load_calibration(path)
