"""The closed loop's budget: which device is ideal, and what the attitude alone costs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.closed_loop import attitude_floor, box, suite_of
from twin.sensors import SensorSuite


def test_one_device_or_all_others_are_made_ideal() -> None:
    field, ideal = SensorSuite.preset("field"), SensorSuite.preset("ideal")
    without, only = suite_of("field", without="compass"), suite_of("field", only="compass")
    for name in field:
        assert without[name] == (ideal if name == "compass" else field)[name]
        assert only[name] == (field if name == "compass" else ideal)[name]
    with pytest.raises(SystemExit, match="did you mean 'compass'"):
        suite_of("field", without="compas")


class Run(dict):
    """As a trajectory."""

    time = 0.5 * np.arange(1000)


def test_the_floor_is_what_a_wrong_heading_makes_of_the_way() -> None:
    zeros = np.zeros(1000)
    run = Run(true_surge=zeros + 0.4, true_sway=zeros, true_heave=zeros)
    for name in ("roll", "pitch", "heading"):
        run[f"true_{name}"] = zeros
        run[f"measured_{name}"] = zeros + (1.0 if name == "heading" else 0.0)
    way = 0.4 * 0.5 * 600
    assert attitude_floor(run, 600) == pytest.approx(2.0 * way * math.sin(math.radians(0.5)))


def test_a_box_is_swung_before_on_request() -> None:
    plain, swung = box(100.0), box(100.0, swing=2)
    assert [one.kind for one in swung.segments] == ["spiral", "spiral", "waypoint"]
    assert swung.segments[2] == plain.segments[0]
