"""The morning page holds what a pilot asks, item by item, of a deployment whose truth is known."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, needs_browser
from matplotlib.quiver import QuiverKey
from matplotlib.text import Annotation

from factory.samples import Flight
from factory.samples.gliders import write_slocum
from glider_twin_ops.pages.figures import mail_figure, track_figure
from glider_twin_ops.pages.morning_page import SHOWN
from glider_twin_ops.watching import one_pass
from glider_twin_ops.watching.morning import Morning
from twin.geodesy import great_circle, offset

FLIGHT = Flight(dives=6, depth=80.0)
AMPERES, VOLTS, KWH, SPENT_AH = 0.25, 14.5, 5.0, 5.0
NEXT = "49.52,-57.98"


@dataclasses.dataclass(frozen=True)
class Page:
    told: Morning
    folder: Path
    html: str
    latest: dict[str, Any]

    def section(self, title):
        """The page from this heading to the next."""
        assert f"<h2>{title}</h2>" in self.html, re.findall("<h2>(.*?)</h2>", self.html)
        return self.html.partition(f"<h2>{title}</h2>")[2].partition("<h2>")[0]

    def features(self, name):
        """Of a GeoJSON file beside it."""
        return json.loads((self.folder / name).read_text())["features"]


def arrive(folder, dives):
    """The log up to a dive, with a counter that takes the same current all the time."""
    flight = dataclasses.replace(FLIGHT, dives=dives)
    spent = SPENT_AH + AMPERES * (flight.time - flight.time[0]) / 3600.0
    write_slocum(folder, flight, m_coulomb_amphr_total=spent, m_battery=0.0 * spent + VOLTS)


@pytest.fixture(scope="module")
def page(tmp_path_factory, deployment):
    """Of the second morning."""
    top = tmp_path_factory.mktemp("morning")
    (top / "arrived").mkdir()
    made = deployment(
        top, top / "arrived", kind="slocum", vehicle="slocum-200", hours=4.0,
        goto=f"{NEXT};49.7,-57.9", energy_kwh=KWH, home="49.4,-58.1",
    )  # fmt: skip
    arrive(top / "arrived", FLIGHT.dives - 1)
    one_pass(made)
    arrive(top / "arrived", FLIGHT.dives)
    passed = one_pass(made)
    folder = passed.page.parent
    latest = json.loads((folder / "latest.json").read_text())
    return Page(passed.told, folder, passed.page.read_text(), latest)


def test_it_is_one_file_without_a_network_for_phone_desktop_light_and_dark(page):
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page.html)
    assert not re.search("https?:", page.html.replace("http://www.w3.org", ""))
    assert 'name="viewport"' in page.html
    assert "prefers-color-scheme: dark" in page.html


def test_the_verdict_comes_first(page):
    assert page.told.verdict == "unit1: 6 dives are too few to judge"
    assert f"<h1>{page.told.verdict}</h1>" in page.html
    assert page.latest["verdict"] == page.told.verdict
    first, *others = (page.folder / "summary.txt").read_text().splitlines()
    assert first == page.told.verdict
    assert 4 <= len(others) <= 9
    fix = page.latest["last_fix"]
    moment = fix["time"][:16].replace("T", " ")
    place = f"{moment} UTC at {fix['latitude']:.4f}, {fix['longitude']:.4f}"
    assert f"<dt>last fix</dt><dd>{place}</dd>" in page.html.partition("<h2>")[0]


def test_where_and_when_next_with_ellipses(page):
    fix = page.latest["last_fix"]
    at = np.array([FLIGHT.time[-1]])
    true = [float(degrees[0]) for degrees in FLIGHT.position(at)]
    assert np.hypot(*offset(np.float64(fix["latitude"]), np.float64(fix["longitude"]), *true)) < 50
    first, *others = page.told.surfacings.surfacings
    assert others
    said = page.section("Next surfacings")
    assert f"{first.latitude:.4f}" in said
    kinds = {one["geometry"]["type"] for one in page.features("forecast.geojson")}
    assert kinds == {"Point", "LineString", "Polygon"}
    half, most = (first.ellipse(part) for part in (0.5, 0.9))
    assert half.semi_major_m < most.semi_major_m
    assert first.early_s <= first.time_s <= first.late_s


def test_track_and_currents(page):
    assert page.section("Track and currents").count("data:image/png") == 2
    north, east = np.mean([one.leg.current for one in page.told.legs], axis=0)
    # the way through the water is that of a vehicle that is not the one that dived
    assert (north, east) == pytest.approx((FLIGHT.north, FLIGHT.east), abs=0.05)
    assert page.latest["current"] == pytest.approx(page.told.legs[-1].leg.current)


def test_the_picture_for_e_mail_has_the_numbers_of_surfacings_and_where_it_goes(page):
    found = page.told.surfacings
    (axes,) = mail_figure("verdict", ["words"], page.told.legs, found).axes
    told = {one.get_text(): one.xy for one in axes.texts if isinstance(one, Annotation)}
    for one in found.surfacings:
        assert told[f"{one.number}"] == pytest.approx((one.longitude, one.latitude))
    places = {line.get_label(): line for line in axes.lines}
    east, north = places["goes to"].get_xydata()[0]
    wanted = [float(word) for word in NEXT.split(",")]
    # at the edge where it is outside
    (low, high), (south, top) = axes.get_xlim(), axes.get_ylim()
    assert (north, east) == pytest.approx(
        (np.clip(wanted[0], south, top), np.clip(wanted[1], low, high)), abs=1e-4
    )


def test_places_can_be_read_off_the_map_and_arrows_have_a_scale(page):
    axes = track_figure(page.told.legs).axes[0]
    assert len(axes.lines) > len(page.told.legs)
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        minutes = float(re.search(r"ticks of ([\d.]+)", axis.get_label_text())[1])
        ticks = axis.get_minor_locator()()
        assert len(ticks) >= 8, ticks
        assert np.diff(ticks) == pytest.approx(minutes / 60.0)
        assert low <= ticks[0] < ticks[-1] <= high
    (key,) = (one for one in axes.artists if isinstance(one, QuiverKey))
    speeds = [np.hypot(*one.leg.current) for one in page.told.legs]
    assert 0.3 * max(speeds) < key.U <= max(speeds)
    assert key.label == f"current {key.U:g} m/s"


def test_the_dives_are_in_a_table_the_newest_first(page):
    numbers = [int(n) for n in re.findall(r"<tr[^>]*><td>(\d+)</td>", page.section("Dives"))]
    assert numbers == sorted(page.told.dives, reverse=True)
    begin, end = FLIGHT.dive_times(FLIGHT.dives - 1)
    last = page.latest["dive_table"][-1]
    assert last["begin"] == pytest.approx(begin, abs=160.0)  # the fix before it
    assert (last["depth"], last["yos"]) == (pytest.approx(FLIGHT.depth, abs=1.0), 1)
    assert last["hours"] == pytest.approx((end - begin) / 3600.0, rel=0.2)
    metres = np.hypot(*FLIGHT.displacement(last["begin"], last["begin"] + 3600.0 * last["hours"]))
    assert last["km"] == pytest.approx(metres / 1e3, rel=0.03)
    assert last["speed"] == pytest.approx(1e3 * last["km"] / last["hours"] / 3600.0)
    assert last["current"] == pytest.approx(page.latest["current"])


def test_the_waypoint_its_distance_and_the_readings_come_first(page):
    top = page.html.partition("<h2>")[0]
    way, fix = page.latest["waypoint"], page.latest["last_fix"]
    assert (way["latitude"], way["longitude"]) == pytest.approx([float(x) for x in NEXT.split(",")])
    away = great_circle(fix["latitude"], fix["longitude"], way["latitude"], way["longitude"])
    assert way["km"] == pytest.approx(away / 1e3, rel=5e-3)  # of a sphere
    assert f"{way['km']:.1f} km towards {way['bearing']:03.0f}" in top
    reading = next(one for one in page.latest["readings"] if one["what"] == "battery")
    assert (reading["value"], reading["unit"]) == (pytest.approx(VOLTS), "V")
    assert FLIGHT.time[-1] - reading["time"] < 600.0
    assert f"<dt>battery</dt><dd>{VOLTS:.4g} V" in top


@needs_browser
def test_a_phone_shows_the_next_position_without_scrolling(page):
    with Browser(390, 844) as browser:
        for scheme in ("light", "dark"):
            browser.prefer(prefers_color_scheme=scheme)
            browser.open(page.folder / "index.html")
            words = "document.querySelector('.next .{}')"
            for name in ("where", "when", "within"):
                here = words.format(name)
                assert browser.run(f"{here}.textContent").strip()
                assert browser.run(f"{here}.getBoundingClientRect().bottom") < 844
            assert browser.problems == []
        assert all(one.startswith(("file:", "data:")) for one in browser.requests)


@needs_browser
def test_no_figure_is_wider_than_a_phone(page):
    with Browser(390, 844) as browser:
        browser.open(page.folder / "index.html")
        assert browser.run("document.documentElement.scrollWidth") <= 390
        wide = "[...document.querySelectorAll('.pair img')].map(one => one.offsetWidth)"
        widths = browser.run(wide)
        assert len(widths) >= 2
        assert max(widths) <= 390


def test_health_says_what_was_asked_and_what_could_not_be(page):
    said = page.section("Health")
    assert said.count("data:image/png") == SHOWN
    assert "not told by this log: " in said.lower().replace("\n", " ")
    assert page.latest["health"]["kind"] == "none"
    assert "pump_rate" in page.latest["health"]["lacking"]
    # the pump's work is no hotel load: it is taken off the power by the charge
    assert 0.5 * AMPERES * VOLTS < page.latest["levels"]["hotel"]["level"] < AMPERES * VOLTS


def test_energy_and_the_last_day_to_turn_home(page):
    used_kwh = AMPERES * page.latest["energy"]["hours"] * VOLTS / 1e3
    days = (KWH - used_kwh) / (AMPERES * VOLTS) * 1e3 / 24.0
    assert page.latest["days_left"] == pytest.approx(days, rel=0.02)
    low, high = page.latest["days_left_90"]
    assert low < page.latest["days_left"] < high
    said = page.section("Energy")
    assert "turn home" in (page.folder / "summary.txt").read_text()
    changes = ("as it is", "1.5 times as deep", "6 degree steeper")
    assert tuple(one.what for one in page.told.outlook.rows) == changes
    assert all(change in said for change in changes)
    # less is told of than there is to ask, and it is said
    assert any("half the samples" in said for said in page.told.lacking)


def test_routes_and_the_files_of_the_plan(page):
    assert "straight" in page.section("Routes")
    line = page.features("routes.geojson")[0]
    latitude, longitude = map(float, NEXT.split(","))
    assert line["geometry"]["coordinates"][-1] == pytest.approx([longitude, latitude], abs=1e-4)
    said = page.section("Proposal")
    for name in ("goto_l10.ma", "yo10.ma", "surfac10.ma"):
        assert name in said
        assert (page.folder / name).is_file()


def test_what_changed_since_the_morning_before(page):
    said = page.section("New since the page before")
    assert f"1 new dive, {FLIGHT.dives - 1}" in said
    assert "too few to judge" in said
