"""Conventions: the same forces and volumes by the basestation's and gliderflight's own formulas."""

import math
from operator import attrgetter

import pytest

from twin.errors import InputError
from twin.identify import load_calibration
from twin.identify.conventions import (
    from_basestation,
    from_gliderflight,
    read_figures,
    to_basestation,
    to_gliderflight,
    write_figures,
)
from twin.vehicle.vehicle import load_vehicle

ALPHA = math.radians(3.0)
"""[rad]"""
SPEED = 0.3
"""[m/s]"""


def drag_and_lift(calibration, speed=SPEED):
    law = calibration.vehicle.flow_frame
    drag = law.drag[0] + law.drag[1] * ALPHA**2
    return drag * speed**2, law.lift[1] * ALPHA * speed**2


def test_basestation_figures_give_the_same_drag_lift_and_volume():
    calibration = load_calibration("seaglider")
    f = to_basestation(calibration, SPEED)
    q = 0.5 * f["rho0"] * SPEED**2
    area = f["glider_length"] ** 2
    drag, lift = drag_and_lift(calibration)
    degrees = math.degrees(ALPHA)
    assert q * area * (f["hd_b"] * q ** f["hd_s"] + f["hd_c"] * degrees**2) == pytest.approx(drag)
    assert q * area * f["hd_a"] * degrees == pytest.approx(lift)
    # at 100 dbar, 4 degC, 50 cm3 pumped: by the basestation's formula, and by ours
    pumped = f["volmax"] - f["vbd_at_volmax"] + 50.0 - f["vbdbias"]
    swelling = f["therm_expan"] * (4.0 - f["temp_ref"]) - f["abs_compress"] * 100.0
    volume = 1e-6 * pumped * math.exp(swelling)
    depth = 100.0 * 1e4 / (calibration.vehicle.reference_density * calibration.vehicle.gravity)
    ours = calibration.vehicle.mass - calibration.net_mass(1000.0, depth, 50.0, 4.0 - 10.0)
    assert volume == pytest.approx(ours / 1000.0, rel=1e-6)


@pytest.mark.parametrize("reference", [10.0, 15.0, 2.0])
def test_a_hull_has_its_neutral_volume_at_the_temperature_of_its_file(reference):
    """Mass over density at that temperature; 7.05e-5 of it less for each kelvin colder."""
    vehicle = load_vehicle("seaglider").replace(hull_reference_temperature=reference)
    calibration = load_calibration(vehicle)
    assert load_vehicle("seaglider").hull_reference_temperature == 15.0
    for temperature in (reference, 25.0, 4.0):
        volume = vehicle.mass / 1025.0 * (1.0 + 7.05e-5 * (temperature - reference))
        net = calibration.net_mass(1026.0, 0.0, 0.0, temperature - 10.0)
        assert net == pytest.approx(vehicle.mass - 1026.0 * volume, abs=1e-4)  # of 4 g a kelvin
    figures = to_basestation(calibration)  # of a hull at 15 degC
    volume = figures["volmax"] - figures["vbd_at_volmax"] - figures["vbdbias"]
    by_file = 1e6 * vehicle.mass / 1025.0 * (1.0 + 7.05e-5 * (15.0 - reference))
    assert volume + vehicle.steered("buoyancy").neutral == pytest.approx(by_file, abs=0.1)
    assert load_calibration(calibration.vehicle).vehicle is calibration.vehicle


def test_gliderflight_figures_give_the_same_drag_lift_and_volume():
    calibration = load_calibration("slocum-200")
    f = to_gliderflight(calibration)
    q = 0.5 * calibration.vehicle.reference_density * f["S"] * SPEED**2
    drag, lift = drag_and_lift(calibration)
    assert q * (f["Cd0"] + f["Cd1"] * ALPHA**2) == pytest.approx(drag)
    assert q * (f["aw"] + f["ah"]) * ALPHA == pytest.approx(lift)
    assert f["mg"] / f["Vg"] == pytest.approx(calibration.vehicle.reference_density)
    assert f["aw"] == pytest.approx(3.7, abs=0.05)  # gliderflight's own estimate for these wings
    swept = math.hypot(7.0 / math.cos(math.radians(43.0)), 2.0)  # aspect ratio 7, by 43 degree
    assert f["aw"] == pytest.approx(14.0 * math.pi / (2.0 + swept))


@pytest.mark.parametrize(
    ("ending", "vehicle", "changes"),
    [
        (".m", "seaglider", {"hull_compressibility": 3.3e-10, "drag": (6.6, 40.0)}),
        (".json", "slocum-1000", {"hull_compressibility": 3.3e-10, "lift": (0.0, 400.0)}),
    ],
)
def test_files_read_back_as_the_vehicle_that_was_written(tmp_path, ending, vehicle, changes):
    nominal = load_calibration(vehicle)
    changed = nominal.vehicle.replace(reference_density=1023.4, **changes)
    mine = nominal.replace(vehicle=changed, thermal_expansion=6.5e-5)
    path = tmp_path / f"figures{ending}"
    write_figures(mine, path)
    again = read_figures(path, nominal)
    for name in ("mass", "reference_density", "hull_compressibility", "law.drag", "law.lift"):
        value = attrgetter(name)(again.vehicle)
        assert value == pytest.approx(attrgetter(name)(mine.vehicle), rel=1e-8)


def test_a_pilots_file_with_comments_is_read(tmp_path):
    path = tmp_path / "sg_calib_constants.m"
    path.write_text(
        "% regressed\nid_str = '171';\nmass = 56.69;\nhd_a = 7.08e-04;\nhd_b = 2.2387e-02;\n"
        "hd_c = 5.7e-06;  % usual\n%hd_b = 1;\nrho0 = 1027.5;\nvolmax = 55848.6;\n"
        "abs_compress = 4.1e-06;\n"
    )
    found = read_figures(path, load_calibration("seaglider"))
    assert found.vehicle.mass == pytest.approx(56.69)
    assert found.vehicle.hull_compressibility == pytest.approx(4.1e-10)
    assert to_basestation(found)["hd_b"] == pytest.approx(2.2387e-2, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{", "is not JSON"),
        ("a.json", '{"Cd1": 10}', "holds no Cd0"),
        ("a.json", '{"Cd0": 0.15, "cd1": 3}', "did you mean 'Cd1'"),
        ("a.json", '{"Cd0": "x"}', "must be a finite number"),
        ("a.json", '{"Cd0": -1}', "must be above 0"),
        ("a.m", "mass = 50;", "holds no hd_a"),
    ],
)
def test_files_and_endings_that_cannot_be_used_are_named(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_figures(path, load_calibration("seaglider"))
    with pytest.raises(InputError, match=r"end in \.m"):
        write_figures(load_calibration("seaglider"), tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("read", "name"), [(from_basestation, "seaglider"), (from_gliderflight, "slocum-200")]
)
def test_figures_that_are_not_given_stay(read, name):
    mine = load_calibration(name)
    again = read({}, mine).vehicle
    assert again.mass == pytest.approx(mine.vehicle.mass)
    for force in ("drag", "lift"):
        wanted = getattr(mine.vehicle.flow_frame, force)
        assert getattr(again.flow_frame, force) == pytest.approx(wanted)
