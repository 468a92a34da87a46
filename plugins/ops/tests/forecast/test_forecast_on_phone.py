"""The page of a forecast on a phone: 390 x 844 CSS pixels."""

from __future__ import annotations

from browser import Browser, needs_browser

from twin.__main__ import PROGRAM

pytestmark = needs_browser
SMALLEST = """
Math.min(...[...document.querySelectorAll("svg text")]
  .filter(one => one.getClientRects().length)
  .map(one => parseFloat(getComputedStyle(one).fontSize) * one.getScreenCTM().a))
"""


def test_words_of_the_map_are_as_large_as_on_a_desk(tmp_path):
    out = tmp_path / "next"
    words = ("--from", "36.8,-122.4,2020-01-01T00:00", "--goto", "36.9,-122.6", "--hours", "6")
    assert PROGRAM.main(["forecast", *words, "--members", "10", "--out", str(out)]) == 0
    with Browser() as browser:
        for width, height in ((1280, 720), (390, 844)):
            browser.resize(width, height, phone=width < 400)
            browser.open(out / "index.html")
            assert browser.run(SMALLEST) > 10.5
            assert browser.run("document.documentElement.scrollWidth") <= width
        browser.run(
            "map.dispatchEvent(new WheelEvent('wheel', {deltaY: -1, clientX: 99, clientY: 99}))"
        )
        assert 10.5 < browser.run(SMALLEST) < 11.5
        assert browser.problems == []
