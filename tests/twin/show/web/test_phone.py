"""The page on a phone: fingers in headless Chromium, 390 x 844 CSS pixels of three each way."""

import numpy as np
import pytest
from browser import Browser, needs_browser

from twin.show.figures.page_layout import Page

pytestmark = needs_browser
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
