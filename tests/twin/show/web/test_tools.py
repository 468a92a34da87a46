"""Tools of the page: surfacings, links, pictures, places, the depth strip, and detail left out."""

import base64
import dataclasses
import io
import re

import numpy as np
import pytest
from browser import Browser, needs_browser
from pictures import dead_reckoned, month, write_page
from PIL import Image

from twin.logs import logged_trajectory
from twin.records.store import read_trajectory
from twin.records.trajectory import Trajectory

pytestmark = needs_browser


def text_of(browser: Browser, name: str) -> str:
    browser.drawn()
    return browser.run(f"document.getElementById('{name}').textContent")


def degrees(text: str) -> float:
    whole, minutes, side = re.findall(r"([\d.]+)° ([\d.]+)′ ([NSEW])", text)[0]
    return (float(whole) + float(minutes) / 60) * (-1 if side in "SW" else 1)


def test_keys_go_from_surfacing_to_surfacing(browser, log_page):
    browser.open(log_page)
    surfacings = browser.run("page.recording.surfacings")
    assert len(surfacings) >= 3
    browser.run("page.seek(page.recording.first)")
    for expected in surfacings:
        browser.press("n")
        assert browser.run("page.time") == expected
        assert browser.run("page.recording.at(page.time).depth") < 3.0
    browser.press("n")
    assert browser.run("page.time") == surfacings[-1]
    assert text_of(browser, "told") == "no later surfacing"
    browser.press("p")
    assert browser.run("page.time") == surfacings[-2]
    assert [text for text in browser.problems if "ReadPixels" not in text] == []


def test_the_position_is_the_store_s(browser, store, page, dives, log_page):
    logged = logged_trajectory(dives, [0, 1, 2])
    for path, trajectory in ((page, read_trajectory(store, 0)), (log_page, logged)):
        browser.open(path)
        latitude, longitude = trajectory.geographic_position()
        known = np.flatnonzero(np.isfinite(latitude) & (trajectory.time > trajectory.time[-1] / 2))
        k = int(known[0])
        browser.run(f"page.seek({trajectory.time[k]})")
        browser.drawn()
        said = browser.run("page.values.position.textContent")
        if said == "–":  # in a gap
            continue
        north, east = said.split(", ")
        assert degrees(north) == pytest.approx(latitude[k], abs=1.1e-5)
        assert degrees(east) == pytest.approx(longitude[k], abs=1.1e-5)


def test_a_link_opens_the_same_moment(browser, page):
    browser.open(page)
    browser.run("page.seek(123.4), page.chooseCamera('side')")
    browser.press("l")
    browser.until("location.hash !== ''")
    assert "link to this moment" in text_of(browser, "told")
    address = browser.run("location.href")
    assert address == f"{page.as_uri()}#t=123.4&camera=side"
    browser.open("about:blank")
    browser.open(address)
    assert browser.run("[page.time, page.scene.name]") == [123.4, "side"]


def test_a_saved_picture_has_the_scene_its_legend_and_its_moment(browser, page):
    browser.open(f"{page.as_uri()}#t=150&camera=chase")
    browser.drawn()
    browser.run("URL.createObjectURL = blob => { window.saved = blob; return 'data:,'; }")
    browser.press("s")
    browser.until("window.saved !== undefined")
    assert re.fullmatch(r"[\w.-]+_150s\.png saved", text_of(browser, "told"))
    data = browser.run(
        "new Promise(done => { const reader = new FileReader();"
        "reader.onload = () => done(reader.result); reader.readAsDataURL(window.saved); })"
    )
    picture = np.asarray(
        Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))).convert("RGB")
    ).astype(int)
    high, wide = picture.shape[:2]
    assert [wide, high] == browser.run("[page.scene.canvas.width, page.scene.canvas.height]")
    yellow = (picture[..., 0] > 150) & (picture[..., 1] > 100) & (picture[..., 2] < 60)
    assert yellow[100:-40, 100:-250].sum() > 500
    shown = browser.picture()[130:400, 300:900].astype(int)
    assert np.abs(picture[130:400, 300:900] - shown).mean() < 2.0
    # words below, and the colour bar of the legend
    assert (picture[-40:, :220].min(axis=-1) > 230).sum() > 100
    bar = picture[16:110, wide - 225 : wide - 25]
    assert (np.ptp(bar, axis=-1) > 100).sum() > 500


def test_the_scale_says_where_it_is_clipped(browser, subject, tmp_path):
    whole = subject.trajectory
    moving = whole.time >= 40.0  # it starts from rest
    signals = {name: row[moving] for name, row in whole.items()}
    for spike, clipped in ((None, False), (3.0, True)):
        fast = signals["true_surge"].copy()
        if spike is not None:
            fast[100:103] = spike
        else:  # nothing beyond what most have
            fast[:] = np.linspace(0.31, 0.39, len(fast))
        part = Trajectory(
            time=whole.time[moving],
            signals=signals | {"true_surge": fast},
            states=np.zeros((0, 0)),
        )
        shown = dataclasses.replace(subject, trajectory=part)
        browser.open(write_page(tmp_path / f"{clipped}.html", shown))
        low, high = browser.run("page.mission.scale.ends")
        assert high.startswith("≥ ") == clipped
        assert high in text_of(browser, "legend")
        speed = np.sqrt(sum(part[f"true_{n}"] ** 2 for n in ("surge", "sway", "heave")))
        assert low.startswith("≤ ") == (speed.min() < float(low.removeprefix("≤ ")) - 1e-6)


def test_axes_of_the_strip_are_beside_the_curve_and_it_can_be_spread(browser, log_page):
    browser.open(log_page)
    browser.drawn()
    frame = browser.run("document.getElementById('strip').getBoundingClientRect().toJSON()")
    whole = browser.run("page.strip.shown")
    x, y = frame["x"] + 200, frame["y"] + 30
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-240)
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-240)
    browser.until("page.strip.span !== null")
    browser.drawn()
    first, last = browser.run("page.strip.shown")
    assert last - first < 0.7 * (whole[1] - whole[0])
    browser.mouse("mousePressed", x, y, button="left", buttons=1)
    browser.mouse("mouseReleased", x, y, button="left")
    share = (200 - 46) / (frame["width"] - 55)
    assert browser.run("page.time") == pytest.approx(first + share * (last - first), rel=1e-3)
    browser.run("page.seek(page.recording.last)")
    browser.drawn()
    assert browser.run("page.strip.shown[1] >= page.time")  # the moment stays in sight
    browser.run("page.strip.showAll()")
    browser.drawn()
    assert browser.run("page.strip.shown") == whole
    # nothing of the curve's colour in the gutter's letters, nor letters on the curve
    ticks = browser.run("timeTicks(page.strip.shown, page.mission.unix, 8)")
    assert 3 <= len(ticks) <= 9
    assert all(re.fullmatch(r"\d\d:\d\d|\d+ [A-Z][a-z]{2}", words) for _, words in ticks)


def test_following_keeps_the_vehicle_in_the_middle(browser, page):
    browser.open(page)
    browser.run("page.chooseCamera('map')")
    browser.press("f")
    for time in (40, 200):
        browser.run(f"page.seek({time})")
        browser.drawn()
        place = browser.run(
            "page.scene.camera.project(page.scene.vehiclePlace(page.recording.at(page.time)))"
        )
        assert np.abs(place[:2]).max() < 1e-6
    browser.press("f")
    browser.drawn()
    assert browser.run("page.scene.following") is False


def test_help_opens_and_closes_by_keys(browser, page):
    browser.open(page)
    browser.press("?")
    assert browser.run("document.getElementById('helping').open") is True
    assert "next, previous surfacing" in text_of(browser, "help")
    above = browser.picture()[110:140, 960:1240]  # what Chromium once left black
    assert (above.max(axis=-1) > 0).mean() > 0.9
    browser.press("Escape")
    assert browser.run("document.getElementById('helping').open") is False


def test_detail_that_is_left_out_is_not_seen(browser, tmp_path):
    """A month has 80 000 points; a picture draws a few thousands of them, and looks the same."""
    subject = month()
    subject = dataclasses.replace(subject, tracks=dead_reckoned(subject.trajectory)[:1])
    browser.open(write_page(tmp_path / "month.html", subject))
    drawn = (
        "(() => { let sum = 0; const draw = page.scene.renderer.drawPath;"
        "page.scene.renderer.drawPath = function (path, look) {"
        " sum += look.count ?? path.count; return draw.call(this, path, look); };"
        "page.scene.draw(page.recording.at(page.time), 0, true);"
        "page.scene.renderer.drawPath = draw; return sum; })()"
    )
    for camera in ("side", "map", "chase"):
        browser.run(f"page.chooseCamera('{camera}'), page.seek(1.3e6)")
        browser.drawn()
        few, picture = browser.run(drawn), browser.picture()[:500].astype(int)
        browser.run(
            "Track.prototype.look_ = Track.prototype.look; Track.prototype.look = function () {"
            " this.seen = this.boxes.map((_, chunk) => [chunk, 0]); }; page.touch()"
        )
        browser.drawn()
        all_, full = browser.run(drawn), browser.picture()[:500].astype(int)
        browser.run("Track.prototype.look = Track.prototype.look_; page.touch()")
        assert few < 0.5 * all_, camera
        away = np.abs(picture - full).max(axis=-1)
        assert away.mean() < 3.0, camera
        assert (away > 60).mean() < 0.025, camera
