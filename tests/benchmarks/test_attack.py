"""Angle of attack of models beside Doppler logs that the test writes."""

import json

import numpy as np
import pd0_files
import pytest

from benchmarks import command
from benchmarks.real_logs import attack
from benchmarks.real_logs.__main__ import main
from twin.vehicle.vehicle import load_vehicle

RATIO, PITCH = 30.0, 24.5
"""[1/rad] Lift over drag of the hull that is written, [degree] its pitch."""


@pytest.fixture
def folder(tmp_path):
    """Three yos of a hull of one ratio; a tilt that stays adds half a degree to dive and climb."""
    vehicle = attack.with_ratio(load_vehicle("slocum-1000"), RATIO)
    angle = attack.glide_angle_of_attack(vehicle, -PITCH)
    place = tmp_path / "slocum_hull_2022"
    place.mkdir()
    for k, tilt in enumerate((0.5, 0.0, -0.5)):
        rows = pd0_files.yo(800, attack=(angle + tilt, -angle + tilt), pitch=PITCH, start=1.7e9 + k)
        pd0_files.write(place / f"yo{k}.pd0", rows)
    (place / "bad.PD0").write_bytes(b"no ensemble")
    return place


def test_the_angle_of_a_glide_has_the_sign_of_heave_and_falls_with_lift_and_pitch():
    vehicle = load_vehicle("slocum-1000")
    angle = attack.glide_angle_of_attack(vehicle, -PITCH)
    assert angle > 0.0
    assert attack.glide_angle_of_attack(vehicle, PITCH) == pytest.approx(-angle)
    assert attack.glide_angle_of_attack(vehicle, -PITCH - 5.0) < angle
    assert attack.glide_angle_of_attack(attack.with_ratio(vehicle, 60.0), -PITCH) < angle


def test_rows_have_bins_left_out_yos_and_the_reason_of_a_bad_file(folder):
    rows = attack.rows_of(folder)
    (bad,) = [row for row in rows if row.kind == "skipped"]
    assert "no whole ensemble" in bad.note
    down = {row.method: row for row in rows if row.data == "yo1, 24 to 25 deg nose down"}
    assert set(down) == {*attack.THRESHOLDS, *attack.SHIPPED, "constant 3 deg"}
    measured = down["Doppler log"]
    assert (measured.low, measured.high) == pytest.approx((measured.value,) * 2)  # no noise
    assert down["slocum-1000"].value < measured.value  # its ratio is larger than the hull's
    errors = {(row.data, row.method): row for row in rows if row.task == attack.LEFT_OUT}
    for name in ("yo0", "yo1", "yo2"):
        # the mean of a dive and of a climb with the other tilt: two hundredths of a degree
        assert errors[name, "ratio of the other yos"].value == pytest.approx(0.0, abs=0.05)
        assert errors[name, "published ratio"].value < errors[name, "slocum-1000"].value < -0.5


def test_the_section_needs_no_other_logs(folder, capsys):
    assert command.run(main, [str(folder.parent), "--only", "attack", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {row["task"] for row in rows} == set(attack.TASKS)
    assert np.isfinite([row["value"] for row in rows if row["kind"] == "truth"]).all()
