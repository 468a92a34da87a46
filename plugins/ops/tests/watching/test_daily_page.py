"""The daily page: arrival, dives, readings, sentences and the map, on made-up numbers."""

import dataclasses
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from glider_twin_ops.forecast import LoggedLeg, mission_to
from glider_twin_ops.health import CHANNELS
from glider_twin_ops.pages.morning_page import write_morning
from glider_twin_ops.pages.surfacing_map import HEIGHT, WIDTH, draw_map
from glider_twin_ops.watching.changes import PHRASES, in_words
from glider_twin_ops.watching.dive_table import dive_rows, newest_readings, polar
from glider_twin_ops.watching.expected_plan import arrival
from glider_twin_ops.watching.log_of_files import log_of_files
from glider_twin_ops.watching.morning import Morning
from glider_twin_ops.watching.sources import SurfaceDialogue
from twin import Origin
from twin.navigation.current import Leg

START = 1_700_000_000.0
BEGINS = "2023-11-14T22:13:20"
"""START as a forecast's place has it"""
SPEED, RADIUS, HOURS = 0.3, 500.0, 12.0


def leg(current, north=3000.0, begin=(49.0, -58.0), hours=3.0, mission=0):
    """A dive to the north in a current."""
    seconds = 3600.0 * hours
    through = north - seconds * current[0], -seconds * current[1]
    motion = Leg(start=START, duration=seconds, over_ground=(north, 0.0), through_water=through)
    return LoggedLeg(mission=mission, leg=motion, method="", begin=begin, onboard=None)


# --- arrival --------------------------------------------------------------------------------------


def found(speeds, km):
    """A forecast of members that make a speed good towards a waypoint so far to the north."""
    times = np.linspace(0.0, 3600.0 * HOURS, 300)
    ways = tuple((times, np.stack([v * times, 0.0 * times], axis=1)) for v in speeds)
    place = Origin(latitude_deg=49.0, longitude_deg=-58.0, time=BEGINS)
    degrees = 1e3 * km / 111_220.0
    mission = mission_to(
        f"{49.0 + degrees},-58.0", depth=100.0, pitch_deg=26.0, surface_after_s=3600.0,
        radius=RADIUS,
    )  # fmt: skip
    return SimpleNamespace(
        request=SimpleNamespace(place=place, mission=mission, horizon=3600.0 * HOURS),
        ways=ways,
        targets=lambda: np.array([[-58.0, 49.0 + degrees]]),
    )


@pytest.mark.parametrize(("km", "beyond"), [(5.0, False), (40.0, True)])
def test_arrival_is_when_the_members_come_within_the_radius(km, beyond):
    one = arrival(found([SPEED] * 9, km))
    assert one.km == pytest.approx(km, rel=2e-3)
    assert one.bearing == pytest.approx(0.0, abs=0.01)
    assert one.speed == pytest.approx(SPEED, rel=1e-3)
    assert one.time - START == pytest.approx((1e3 * one.km - RADIUS) / SPEED, abs=150.0)
    assert one.beyond == beyond
    assert one.early == one.late == one.time


def test_arrival_is_early_by_the_fast_and_never_by_those_that_drift_away():
    one = arrival(found([0.6, 0.3, 0.3, -0.1, -0.1], 40.0))
    assert one.early - START == pytest.approx((1e3 * one.km - RADIUS) / 0.6, rel=1e-3)
    assert math.isinf(one.late)
    assert one.describe()["late"] is None
    assert one.describe()["time"].endswith("Z")
    assert math.isinf(arrival(found([-0.1] * 5, 40.0)).time)


# --- dives and readings ---------------------------------------------------------------------------


class Logs(dict):
    """Signals of one dive by their names."""

    starts, period = np.array([START]), 10.0

    def signal(self, name, row):
        return self.get(name, np.full(len(self["measured_depth"]), np.nan))

    def number(self, name):
        return np.array([3600.0])


def test_yos_are_descents_that_a_climb_follows_and_what_is_not_known_is_a_dash():
    phase = np.array([0, 1, 1, 3, 2, 2, 3, 1, 3, 2, 1, 0, 0], float)
    logs = Logs(measured_depth=np.where(phase > 0, 50.0, 0.0), measured_phase=phase)
    (one,) = dive_rows(logs, [0], [7], [])
    assert (one.number, one.yos, one.depth, one.hours) == (7, 2, 50.0, 1.0)
    cells = one.row()
    known = {"dive", "from, UTC", "hours", "depth [m]", "yos"}
    assert {cells[name] for name in {*cells} - known} == {"-"}
    assert one.describe()["current"] is None
    (one,) = dive_rows(logs, [0], [7], [leg((-0.1, 0.0), hours=1.0)])
    assert (one.km, one.course) == (pytest.approx(3.0), 0.0)
    assert one.row()["current towards"] == "180"


def test_courses_are_below_360():
    assert polar(1.0, -1e-4) == (pytest.approx(1.0), 0.0)
    assert polar(0.0, -2.0) == (2.0, 270.0)


def test_readings_are_those_of_the_log_or_of_a_newer_dialogue():
    depth, volts = np.zeros(200), np.full(200, np.nan)
    volts[[0, 100, 120, 140]] = 16.0, 14.0, 14.2, 14.1
    logs = Logs(measured_depth=depth, measured_voltage=volts)
    (log,) = newest_readings(logs, [0], None)
    assert (log.what, log.value, log.time) == ("battery", pytest.approx(14.1), START + 1400.0)
    said = SurfaceDialogue(
        vehicle="unit", time=START + 2000.0, fix=None, fix_time=None, why="", aborts=None,
        sensors={"m_battery": (13.5, "volts"), "m_vacuum": (7.1, "inHg"), "m_depth": (0.0, "m")},
    )  # fmt: skip
    newer = newest_readings(logs, [0], said)
    assert [one.text() for one in newer] == [
        "13.5 V, 11-14 22:46", "7.1 inHg, 11-14 22:46",
    ]  # fmt: skip
    older = newest_readings(logs, [0], dataclasses.replace(said, time=START))
    assert older[0] == log


# --- sentences ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "level", "deviation", "said"),
    [
        # the log's rate is 1.01 and 1 / 1.148 of the model's
        (
            "rate_dive", 1.0 - 1.0 / 1.01, 0.002,
            "in dives it sinks 1.0 +- 0.2 % faster than identified",
        ),
        ("rate_climb", -0.148, 0.006, "in climbs it rises 12.9 +- 0.5 % slower than identified"),
        (
            "trim_dive", -14.6, 0.11,
            "in dives its battery is 14.6 +- 0.1 mm aft of where the pitch needs it",
        ),
        ("roll_climb", 0.36, 0.06, "in climbs it rolls 0.36 +- 0.06 degree to starboard"),
        ("pump_rate", math.log(20.0), 0.01, "its pump moves 20.0 +- 0.2 cm3/s"),
        ("hotel", 2.771, 0.02, "it takes 2.77 +- 0.02 W while no pump runs"),
        ("temperature_lag", 0.0, 300.0, ""),
        ("rate_dive", math.nan, 0.01, ""),
    ],
)  # fmt: skip
def test_levels_are_said_as_people_speak(name, level, deviation, said):
    assert in_words(name, level, deviation, "identified") == said


def test_every_channel_has_its_sentence():
    assert list(PHRASES) == [one.name for one in CHANNELS]
    for one in CHANNELS:
        assert in_words(one.name, 0.1, 0.5 * one.noise, "identified"), one.name


# --- map ------------------------------------------------------------------------------------------


def arrows(svg):
    """Base and tip of each arrow [px], right and down; the last one is the key's."""
    group = svg.partition('<g class="current">')[2].partition("</g>")[0]
    bases = re.findall(r'<path d="M([\d.-]+) ([\d.-]+)L', group)
    tips = re.findall(r'<polygon points="([\d.-]+),([\d.-]+)', group)
    return np.concatenate([np.array(bases, float), np.array(tips, float)], axis=1)


def test_arrows_of_the_map_point_where_the_current_goes_and_have_the_key_s_scale():
    currents = [(0.3, 0.0), (0.0, -0.15), (-0.1, 0.1)]
    svg = draw_map(None, [leg(current) for current in currents])
    *drawn, key = arrows(svg)
    speed = float(re.search(r"current ([\d.]+) m/s", svg)[1])
    assert speed == 0.2
    scale = (key[2] - key[0]) / speed
    for (x, y, right, down), (north, east) in zip(drawn, currents, strict=True):
        assert ((right - x) / scale, (y - down) / scale) == pytest.approx((east, north), abs=2e-3)


def test_dives_across_the_date_line_lie_together():
    legs = [leg((0.1, 0.0), begin=(10.0, west)) for west in (179.99, -179.99)]
    svg = draw_map(None, legs)
    fixes = re.findall(r'class="fix" cx="([\d.-]+)" cy="([\d.-]+)"', svg)
    assert len(fixes) == 2
    assert all(0.0 <= float(x) <= WIDTH and 0.0 <= float(y) <= HEIGHT for x, y in fixes)


# --- page -----------------------------------------------------------------------------------------


def test_texts_of_logs_and_dialogues_are_no_html(tmp_path, watched):
    log = log_of_files(watched(), tmp_path)
    evil = "<script>alert(1)</script>"
    dialogue = SurfaceDialogue(
        vehicle=evil, time=START, fix=(49.0, -58.0), fix_time=START, why=evil, aborts=1,
        sensors={evil: (1.0, evil)},
    )  # fmt: skip
    told = Morning(
        title=evil, log=log, deployment=evil, dialogue=dialogue, plan=evil, lacking=(evil,),
        legs=(leg((0.1, 0.0)),), dives=(0,),
    )  # fmt: skip
    page = write_morning(told, tmp_path, new=[evil], made={}, came=[evil]).read_text()
    assert "alert(1)" in page
    assert evil not in page


def test_a_page_without_a_forecast_says_why_at_its_top(tmp_path, watched):
    log = log_of_files(watched(), tmp_path)
    told = Morning(title="calypso", log=log, lacking=("forecast: no dive lies between two fixes",))
    page = write_morning(told, tmp_path, new=[], made={}).read_text()
    top = page.partition("<h2>")[0]
    assert "not known" in top
    assert "no dive lies between two fixes" in top
    assert "<svg" not in page
