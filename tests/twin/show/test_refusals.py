"""Commands that draw refuse in one line what they cannot do, and leave nothing behind."""

import pytest
from pictures import refused


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("plot STORE --figure trak", "did you mean 'track'"),
        ("plot STORE --out a.bmp", "must be one of .png, .pdf, .svg"),
        ("plot STORE --figure all --out a.png", "needs a folder"),
        ("plot STORE --mission 2", "has missions 0 to 1, not 2"),
        ("plot STORE --tracks none.csv", "no track file at none.csv"),
        ("render STORE --out dive.avi", "must be one of .png, .mp4, .gif"),
        ("render STORE --size axb", "WIDTHxHEIGHT"),
        ("render STORE --out a.mp4 --size 161x96", "even width and height"),
        ("render STORE --out a.mp4 --time 5", "--time is for a .png"),
        ("render STORE --out a.png --time 900", "outside the shown part"),
        ("render STORE --out a.png --start 200 --end 100", "must be inside the mission"),
        ("render STORE --out a.png --mission 2", "has missions 0 to 1, not 2"),
        ("render STORE --out a.png --mission -1", "has missions 0 to 1, not -1"),
        ("render STORE --out a.png --tracks none.nc", "no track file at none.nc"),
        ("render STORE --out a.png --vehicle glidr", "did you mean 'glider'"),
        ("render STORE --out a.png --vehicle tethys", "has its own vehicle: glider"),
        ("render STORE --html a.html --vehicle tethys", "--vehicle is for logs"),
        ("render STORE --html a.html --size 640x360", "--size: not for a page"),
        ("render STORE --out a.html --no-hud --workers 2", "--no-hud, --workers: not for a page"),
        ("render STORE --html a.html --out b.png", "--out b.png and --html a.html: give one of"),
        ("render STORE --html a.png", "the ending must be .html"),
        ("render STORE --out a.pdf", ".html"),
        ("render STORE --html a.html --colour error", "give --tracks FILE"),
        ("render STORE --html a.html --missions 0-1", "several missions together are for logs"),
        ("render STORE --html a.html --time 1e6", "outside the shown part"),
        ("view --seconds 0", "--seconds 0 must be positive"),
        ("view --camera orbt", "orbit"),
    ],
)
def test_refusals_are_one_line_and_leave_nothing(
    capsys, store, tmp_path, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    told = refused(capsys, *(store if word == "STORE" else word for word in words.split()))
    assert message in told
    assert not list(tmp_path.iterdir())
