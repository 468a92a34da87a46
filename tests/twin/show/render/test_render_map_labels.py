"""Labels and colours of the map: one style for all of them, none taken by two things."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from twin.show.render import canvas as palette
from twin.show.render import sea, tags


@pytest.fixture
def marks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    canvas = SimpleNamespace(px=lambda n: n, width=1280, height=720)
    layout = SimpleNamespace(low=(-1100.0, -1600.0, 0.0), display_block=lambda points: points)
    view = SimpleNamespace(project=lambda points: points)
    values = {0: np.array([-1000.0, -500.0, 0.0]), 1: np.array([-1500.0, 0.0, 500.0])}
    monkeypatch.setattr(sea, "grid_values", lambda layout, axis: values[axis])
    monkeypatch.setattr(tags, "scale_bar", lambda *_: (500.0, (0, 0, 100, 4)))
    return [mark.text for mark in tags.map_marks(canvas, layout, view)]


def test_every_label_has_distance_unit_and_direction(marks: list[str]) -> None:
    assert marks == [
        *("1000 m S", "500 m S", "0 m N"),
        *("1500 m W", "0 m E", "500 m E"),
        "500 m",
    ]


def test_the_first_tracks_have_not_the_colour_of_the_current() -> None:
    for colour in palette.OTHER_TRACKS[:4]:
        assert np.abs(colour - palette.CURRENT).max() > 0.2
    assert len({tuple(colour) for colour in palette.OTHER_TRACKS}) == len(palette.OTHER_TRACKS)
