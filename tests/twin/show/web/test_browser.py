"""The page in a real browser and on a phone: it opens, obeys, and shows what the store holds."""

import dataclasses
import re

import mujoco
import numpy as np
import pytest
from browser import Browser, needs_browser
from pictures import dead_reckoned, short_scenario, write_page

from twin.faults.hull import WingLost
from twin.frames import flip_vector
from twin.logs import logged_trajectory
from twin.mission.shipped_missions import load_mission_for
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.store import read_trajectory
from twin.show.figures.page_layout import Page
from twin.show.render.playback import poses
from twin.show.render.subject import Shot, Subject
from twin.show.web.page import assemble
from twin.show.web.server import LiveMission, PageServer
from twin.vehicle.vehicle import load_vehicle

CAMERAS = ("orbit", "side", "map", "chase")
pytestmark = needs_browser


def scene(browser: Browser) -> np.ndarray:
    """The middle of the picture, where nothing but the scene is."""
    browser.drawn()
    return browser.picture()[130:480, 250:1000]


def readouts(browser: Browser) -> dict[str, str]:
    browser.drawn()
    return browser.run(
        "Object.fromEntries([...document.querySelectorAll('dd')].map("
        "one => [one.dataset.name, one.textContent]))"
    )


def number(text: str) -> float:
    """The first number of a readout; what is heavy counts as positive."""
    (found, *_) = re.findall(r"[−+]?\d+\.?\d*", text)
    value = float(found.replace("−", "-"))
    return -value if text.startswith("▲") else value


def complaints(browser: Browser) -> list[str]:
    """Errors and warnings of the page; reading a picture back makes drivers chat."""
    return [text for text in browser.problems if "ReadPixels" not in text]


def slide_to(browser: Browser, time: float) -> None:
    """As a hand that moves the slider."""
    browser.run(
        f"(slider => {{ slider.value = {time}; slider.dispatchEvent(new Event('input')); }})"
        "(document.getElementById('slider'))"
    )


def test_it_opens_offline_and_shows_what_the_store_holds(browser, page, store):
    trajectory = read_trajectory(store, 0)
    browser.open(page)
    for k in (0, 136, len(trajectory.time) - 1):
        slide_to(browser, float(trajectory.time[k]))
        shown = readouts(browser)
        true = {name: float(trajectory[f"true_{name}"][k]) for name in ("depth", "pitch", "roll")}
        for name, value in true.items():
            assert abs(number(shown[name]) - value) < 0.056, name
        assert abs(number(shown["heading"]) - trajectory["true_heading"][k]) < 0.51
        assert abs(number(shown["surge"]) - trajectory["true_surge"][k]) < 0.0051
        over_ground = np.hypot(
            *(trajectory[f"true_velocity_{name}"][k] for name in ("north", "east"))
        )
        assert abs(number(shown["over ground"]) - over_ground) < 0.0051
        current = np.hypot(*(trajectory[f"true_current_{name}"][k] for name in ("north", "east")))
        assert abs(number(shown["current"]) - current) < 0.0051
        mass = trajectory["true_net_mass"][k]
        if shown["net buoyancy"] == "neutral":
            assert abs(mass) < 0.0051
        else:
            assert abs(number(shown["net buoyancy"]) - mass) < 0.0051
        whole = round(trajectory.time[k])
        assert shown["time"] == f"0:{whole // 60:02d}:{whole % 60:02d}"
    assert complaints(browser) == []
    assert browser.requests == [page.as_uri()]


def test_each_camera_shows_another_picture(browser, page):
    browser.open(page)
    slide_to(browser, 150.0)
    pictures = []
    for name in CAMERAS:
        browser.run(f"[...document.querySelectorAll('nav button')].find("
                    f"one => one.textContent === '{name}').click()")  # fmt: skip
        pictures.append(scene(browser).astype(float))
        assert len(np.unique(pictures[-1].reshape(-1, 3), axis=0)) > 500, name
    for i, one in enumerate(pictures):
        for other in pictures[i + 1 :]:
            assert np.abs(one - other).mean() > 5.0
    # the vehicle's own yellow is seen in each
    for name, one in zip(CAMERAS, pictures, strict=True):
        yellow = (one[..., 0] > 150) & (one[..., 1] > 100) & (one[..., 2] < 60)
        assert yellow.sum() > 150, name
    assert complaints(browser) == []


def test_keys_play_jump_and_choose_cameras(browser, page):
    browser.open(page)
    browser.run("page.seek(100)")
    browser.press("ArrowRight")
    assert browser.run("page.time") == pytest.approx(106.0)
    browser.press("ArrowLeft")
    browser.press("ArrowLeft")
    assert browser.run("page.time") == pytest.approx(94.0)
    browser.press("4")
    assert browser.run("page.scene.name") == "chase"
    browser.press("End")
    assert browser.run("page.time") == pytest.approx(300.0)
    browser.press("Home")
    browser.press(" ")
    browser.until("page.time > 3")
    browser.press(" ")
    paused = browser.run("page.time")
    browser.drawn()
    assert browser.run("page.time") == paused
    assert browser.run("page.playing") is False


def test_the_mouse_turns_and_the_wheel_comes_nearer(browser, page):
    browser.open(f"{page.as_uri()}#t=200&camera=side")
    before = scene(browser).astype(float)
    assert browser.run("page.time") == 200.0
    browser.mouse("mousePressed", 600, 300, button="left", buttons=1)
    browser.mouse("mouseMoved", 700, 260, button="left", buttons=1)
    browser.mouse("mouseReleased", 700, 260, button="left")
    turned = scene(browser).astype(float)
    assert np.abs(turned - before).mean() > 3.0
    distance = browser.run("page.scene.camera.distance")
    browser.mouse("mouseWheel", 600, 300, deltaX=0, deltaY=-300)
    browser.until(f"page.scene.camera.distance < {0.9 * distance}")
    browser.run("page.chooseCamera('side')")
    np.testing.assert_allclose(scene(browser), before, atol=3.0)


def test_currents_and_tracks_are_drawn(browser, subject, tmp_path):
    with_tracks = dataclasses.replace(subject, tracks=dead_reckoned(subject.trajectory))
    browser.open(write_page(tmp_path / "tracks.html", with_tracks, camera="map"))
    browser.run("page.seek(300)")
    picture = scene(browser).astype(int)
    for track in ((0.15, 0.90, 0.50), (1.00, 0.58, 0.78)):
        near = np.abs(picture - np.rint(255 * np.array(track))).max(axis=-1) < 12
        assert near.sum() > 100
    browser.press("c")
    assert np.abs(scene(browser).astype(int) - picture).max() > 100
    legend = browser.run("document.getElementById('legend').textContent")
    assert "network" in legend
    assert "current, up to" in legend


def test_a_log_shows_its_date_and_dashes_where_nothing_is_known(browser, dives, log_page):
    log = logged_trajectory(dives, [0, 1, 2])
    browser.open(log_page)
    k = int(np.argmax((log["true_depth"] > 20.0) & (log["measured_gap"] == 0.0)))
    slide_to(browser, float(log.time[k]))
    shown = readouts(browser)
    assert abs(number(shown["depth"]) - log["true_depth"][k]) < 0.056
    assert abs(number(shown["pitch"]) - log["true_pitch"][k]) < 0.056
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d", shown["date, UTC"])
    assert "net buoyancy" not in shown
    between = int(np.argmax(np.nan_to_num(log["measured_gap"], nan=1.0) > 0.0))
    slide_to(browser, float(log.time[between]))
    assert readouts(browser)["depth"] == "–"
    assert complaints(browser) == []


@pytest.mark.parametrize("name", ["glider", "tethys"])
def test_moving_parts_stand_where_mujoco_has_them(browser, tmp_path, name):
    vehicle = load_vehicle(name)
    plan = load_mission_for(vehicle, None)
    trajectory = simulate(Scenario(vehicle=vehicle, mission=plan, duration=400.0))
    subject = Subject(trajectory=trajectory, vehicle=vehicle)
    browser.open(write_page(tmp_path / "parts.html", subject))
    found = browser.run("page.scene.vehicle.poses(page.recording.at(350))")
    pose = poses(trajectory, np.array([350.0]))
    model = mujoco.MjModel.from_xml_string(vehicle.xml)
    data = mujoco.MjData(model)
    data.qpos[:7] = [0.0, 0.0, 0.0, *pose.quaternion[0]]
    for joint in range(model.njnt):
        part = model.joint(joint).name
        if part in pose.joints:
            value = pose.parts[0, pose.joints.index(part)]
            data.qpos[model.jnt_qposadr[joint]] = value
    for part in vehicle.parts:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, part.name)
        if body >= 0 and part.drawn_axis is not None and part.name in pose.joints:
            angle = pose.angles[0, pose.joints.index(part.name)]
            turn, both = np.zeros(4), np.zeros(4)
            mujoco.mju_axisAngle2Quat(turn, flip_vector(np.array(part.drawn_axis)), angle)
            mujoco.mju_mulQuat(both, turn, model.body_quat[body])
            model.body_quat[body] = both
    mujoco.mj_kinematics(model, data)
    hull = model.body("hull").id
    bodies = [hull, *(b for b in range(1, model.nbody) if b != hull)]
    assert len(found) == len(bodies) > 1
    for one, body in zip(found, bodies, strict=True):
        np.testing.assert_allclose(one["place"], data.xpos[body] - data.xpos[hull], atol=5e-4)
        same = abs(np.dot(one["turn"], data.xquat[body]))
        assert same > 1.0 - 1e-4, model.body(body).name  # a propeller's rates are rounded


def test_a_light_page_is_light(browser, page):
    browser.open(page)
    panels = []
    for scheme in ("light", "dark"):
        browser.prefer(prefers_color_scheme=scheme)
        browser.drawn()
        panels.append(browser.picture()[600:, :40].mean())
    browser.prefer()
    assert panels[0] > 180.0
    assert panels[1] < 80.0


def test_without_webgl_the_map_is_flat_and_the_page_says_so(page, store):
    with Browser(900, 600, "--disable-3d-apis") as browser:
        browser.open(page)
        browser.run("page.seek(200)")
        browser.drawn()
        assert "no WebGL2" in browser.run("document.getElementById('alert').textContent")
        depth = read_trajectory(store, 0)["true_depth"][400]
        assert abs(number(readouts(browser)["depth"]) - depth) < 0.06
        picture = browser.picture()[100:400, 200:700]
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


def test_a_browser_follows_a_live_mission(browser, subject):
    mission = LiveMission(short_scenario(), subject, Shot(), 40.0)
    with PageServer(0) as server:
        server.show(assemble(mission.mission, connect="'self'"), mission)
        browser.problems.clear()
        browser.open(server.address)
        browser.until("page.time > 20")
        assert browser.run("page.recording.last") < 300.0
        assert browser.run("document.getElementById('moment').textContent") == "live"
        browser.until("page.recording.last > 60")
        with Browser(900, 600) as late:  # joins where the mission is now
            late.open(server.address)
            late.until("page.recording.times.length > 2")
            assert late.run("page.time") > 60.0
            assert complaints(late) == []
        browser.run("page.setPlaying(false)")
        browser.until("!page.live.running")
        assert browser.run("page.recording.last") == 300.0
        slide_to(browser, 150.0)
        expected = subject.trajectory
        k = int(np.searchsorted(expected.time, 150.0))
        assert abs(number(readouts(browser)["depth"]) - expected["true_depth"][k]) < 0.056
        assert complaints(browser) == []


def test_a_lost_wing_is_not_drawn_from_its_moment_on(browser, subject, tmp_path):
    pictures = []  # of the same flight: what differs is the drawing
    for faults in ([], [WingLost(side="both", start=150.0)]):
        drawn = dataclasses.replace(subject, faults=faults)
        browser.open(write_page(tmp_path / f"{len(faults)}.html", drawn, camera="chase"))
        for time in (100.0, 200.0):
            slide_to(browser, time)
            pictures.append(scene(browser).astype(int))
    before, after = (np.abs(pictures[k] - pictures[k + 2]).max() for k in range(2))
    assert before < 40 < after


# --- on a phone: fingers, 390 x 844 CSS pixels of three each way ----------------------------------


WIDE, HIGH = 390, 844


@pytest.fixture(scope="module")
def phone(page):
    """The page of a short mission, opened on it."""
    with Browser() as browser:
        browser.resize(WIDE, HIGH, phone=True)
        browser.open(page)
        yield browser


def box(browser: Browser, selector: str) -> dict[str, float]:
    return browser.run(f"document.querySelector('{selector}').getBoundingClientRect().toJSON()")


def middle(browser: Browser, selector: str) -> tuple[float, float]:
    one = box(browser, selector)
    return one["x"] + one["width"] / 2, one["y"] + one["height"] / 2


def tap(browser: Browser, selector: str) -> None:
    browser.fingers([middle(browser, selector)])
    browser.drawn()


def test_all_is_in_sight_and_large_enough_for_a_finger(phone):
    assert phone.run("matchMedia('(pointer: coarse)').matches")
    assert phone.run("document.documentElement.scrollWidth") <= WIDE
    sizes = phone.run(
        "[...document.querySelectorAll('button, select, summary, #slider')].map(one => {"
        "const b = one.getBoundingClientRect();"
        "return [one.id || one.textContent, b.width, b.height, b.right, b.bottom]; })"
    )
    assert len(sizes) >= 12
    for name, wide, high, right, bottom in sizes:
        assert min(wide, high) >= 44, name
        assert right <= WIDE, name
        assert bottom <= HIGH, name
    view, panel = box(phone, "#view"), box(phone, "#panel")
    assert panel["top"] >= view["bottom"] - 0.5
    assert view["height"] > 0.42 * HIGH
    covering = [box(phone, name) for name in ("#head", "#legend", "#cameras")]
    assert sum(one["width"] * one["height"] for one in covering) < 0.5 * view["height"] * WIDE


def test_one_finger_turns_and_two_come_nearer(phone):
    phone.run("page.chooseCamera('orbit')")
    phone.drawn()
    before = phone.run("({...page.scene.camera})")
    x, y = middle(phone, "#scene")
    phone.fingers([(x, y)], [(x + 30, y + 10)], [(x + 80, y + 20)])
    phone.drawn()
    turned = phone.run("({...page.scene.camera})")
    assert turned["bearing"] == pytest.approx(before["bearing"] - 80 * 0.006, abs=1e-6)
    assert turned["elevation"] == pytest.approx(before["elevation"] + 20 * 0.006, abs=1e-6)
    assert turned["distance"] == pytest.approx(before["distance"])
    phone.fingers(*([(x, y - r), (x, y + r)] for r in (40, 60, 80)))
    phone.drawn()
    nearer = phone.run("page.scene.camera.distance")
    assert nearer == pytest.approx(turned["distance"] / 2, rel=0.02)
    assert phone.run("visualViewport.scale") == 1  # not the page was zoomed
    phone.fingers([(x, y), (x, y + 90)], [(x + 50, y), (x + 50, y + 90)])
    assert phone.run("Math.hypot(...page.scene.hand.move)") > 1.0
    phone.run("page.chooseCamera('orbit')")
    phone.drawn()
    assert phone.run("page.scene.camera.distance") == pytest.approx(before["distance"])


def test_slider_curve_and_buttons_obey_a_finger(phone):
    phone.run("page.seek(0)")
    phone.drawn()
    slider = box(phone, "#slider")
    y = slider["y"] + slider["height"] / 2
    phone.fingers([(slider["x"] + 15, y)], [(slider["x"] + 100, y)], [(slider["right"] - 100, y)])
    share = 1 - (100 - 15) / (slider["width"] - 30)
    assert phone.run("page.time") == pytest.approx(300 * share, abs=6.0)
    strip = box(phone, "#strip")
    phone.fingers([(strip["x"] + 46 + (strip["width"] - 55) / 2, strip["y"] + 20)])
    assert phone.run("page.time") == pytest.approx(150.0, abs=1.0)
    # the thumb stands below the moment of the curve
    where = phone.run(
        "(s => s.getBoundingClientRect().x + 15 + (s.getBoundingClientRect().width - 30)"
        " * (s.value - s.min) / (s.max - s.min))(document.getElementById('slider'))"
    )
    assert where == pytest.approx(strip["x"] + 46 + (strip["width"] - 55) / 2, abs=1.5)
    tap(phone, "nav button:nth-child(4)")
    assert phone.run("page.scene.name") == "chase"
    tap(phone, "#play")
    phone.until("page.time > 152")
    tap(phone, "#play")
    assert phone.run("page.playing") is False
    tap(phone, "summary")
    help_ = box(phone, "#help")
    assert help_["left"] >= 0
    assert help_["right"] <= WIDE
    assert help_["top"] >= 0
    tap(phone, "summary")


def test_the_picture_is_a_phone_sharp_one(phone):
    phone.run("page.chooseCamera('side')")
    phone.drawn()
    picture = phone.picture()
    assert picture.shape == (3 * HIGH, 3 * WIDE, 3)
    assert len(np.unique(picture[600:1200].reshape(-1, 3), axis=0)) > 500
    assert phone.run("page.scene.canvas.width") == 2 * WIDE  # what a phone still draws fast


def test_a_table_has_a_shade_where_it_goes_on_beyond_the_edge(tmp_path):
    page = Page(tmp_path / "page", "Sound", "lead")
    page.table([{f"column {k}": 1.25 * k + row for k in range(9)} for row in range(4)])
    path = page.write()

    def shades(browser: Browser) -> tuple[bool, bool]:
        """Whether the table's left and right edges differ from the ground beside them."""
        browser.drawn()
        edge, seen = box(browser, ".scroll"), browser.picture().astype(int)
        zoom = seen.shape[1] / browser.run("innerWidth")
        high = round((edge["top"] + 10) * zoom)
        ground = seen[high, 3]
        at = (round(edge["left"] * zoom) + 1, round(edge["right"] * zoom) - 2)
        left, right = (bool(abs(seen[high, x] - ground).max() > 20) for x in at)
        return left, right

    with Browser() as browser:
        for scheme in ("light", "dark"):
            browser.prefer(prefers_color_scheme=scheme)
            browser.resize(1400, HIGH)
            browser.open(path)
            assert shades(browser) == (False, False)
            browser.resize(WIDE, HIGH, phone=True)
            browser.open(path)
            for left, shown in ((0, (False, True)), (60, (True, True)), (9999, (True, False))):
                browser.run(f"document.querySelector('.scroll').scrollLeft = {left}")
                assert shades(browser) == shown
