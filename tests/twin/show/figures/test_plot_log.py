"""The figure of a log: what it leaves out, how it shows gaps, headings and spikes; captions."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from twin.records.attributes import CONVENTIONS, READER_VERSION
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.records.trajectory import Trajectory
from twin.show import style
from twin.show.figures.logged_dive import GAP_COLOUR, gap_spans, log_figure, robust_limits
from twin.show.figures.page_layout import (
    add_caption,
    mission_caption,
    missions_caption,
    place,
)
from twin.show.figures.signals import centred_line, circular_mean
from twin.show.figures.track import space_axes
from twin.version import IMPORT_VERSION


def logged(**signals: np.ndarray) -> Trajectory:
    """A dive to 60 m and back in half an hour."""
    time = np.arange(0.0, 1800.0, 2.0)
    depth = 60.0 - np.abs(time - 900.0) / 15.0
    given = {
        "measured_depth": depth,
        "measured_pitch": np.where(time < 900.0, -26.0, 26.0),
        "measured_heading": np.mod(350.0 + 20.0 * np.sin(time / 50.0), 360.0),
        "measured_phase": np.where(time < 900.0, 1.0, 2.0),
        "measured_gap": np.zeros(len(time)),
    }
    return Trajectory(time=time, signals={**given, **signals}, states=np.zeros((0, 23)))


def titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_the_wide_panel_says_its_times():
    top = log_figure(logged()).axes[0]
    assert top.get_xlabel() == "time [min]"
    assert top.xaxis.get_tick_params()["labelbottom"]


def test_only_what_was_logged_has_a_panel():
    count = len(logged().time)
    assert titles(log_figure(logged())) == [
        *("depth", "vertical speed, down", "pitch", "heading from true north"),
    ]
    more = log_figure(
        logged(
            measured_density=np.full(count, np.nan),
            measured_fin=np.zeros(count),
            measured_temperature=np.full(count, 8.0),
            measured_rotation=np.zeros(count),
        )
    )
    assert "density" not in titles(more)
    assert {"rudder", "temperature", "battery rotation"} <= set(titles(more))


def test_gaps_are_shaded_in_every_panel():
    gap = np.zeros(len(logged().time))
    gap[100:120] = 1.0
    gap[-5:] = 1.0
    assert gap_spans(gap) == [(100, 119), (len(gap) - 5, len(gap) - 1)]
    figure = log_figure(logged(measured_gap=gap))
    for axes in figure.axes:
        shaded = [p for p in axes.patches if to_hex(p.get_facecolor()).upper() == GAP_COLOUR]
        assert len(shaded) == 2
    assert "gap of the log, bridged" in [
        text.get_text() for text in figure.axes[0].get_legend().get_texts()
    ]
    assert not log_figure(logged()).axes[0].patches


def test_a_heading_about_north_is_one_line():
    heading = logged()["measured_heading"]
    assert np.ptp(heading) > 300.0
    line = centred_line(heading, circular_mean(heading))
    assert np.isfinite(line).all()
    assert np.ptp(line) < 41.0
    np.testing.assert_allclose(np.mod(line, 360.0), heading, atol=1e-9)
    turning = centred_line(np.mod(np.arange(0.0, 720.0, 5.0), 360.0), 0.0)
    assert 1 <= np.isnan(turning).sum() <= 3
    assert np.isnan(circular_mean(np.array([np.nan]))) == 0


def test_a_roll_in_the_waves_does_not_flatten_the_dive():
    depth = logged()["measured_depth"]
    roll = np.where(depth < 1.0, 120.0, 2.0 * np.sin(np.arange(len(depth)) / 9.0))
    low, high = robust_limits(roll, depth, 4.0)
    assert -4.0 < low < high < 4.0
    assert robust_limits(np.full(3, np.nan), np.zeros(3), 1.0) is None
    low, high = robust_limits(np.full(3, 5.0), np.full(3, 9.0), 4.0)
    assert (low + high) / 2 == pytest.approx(5.0)
    assert high - low >= 4.0


def test_the_vertical_speed_is_the_depth_rate():
    figure = log_figure(logged())
    rate = figure.axes[1].lines[0].get_ydata()
    assert np.nanmax(rate) == pytest.approx(100.0 / 15.0)
    assert np.nanmin(rate) == pytest.approx(-100.0 / 15.0)


def test_captions_tell_missions_apart(tmp_path):
    def written(name: str, data: xr.Dataset, **attributes: str) -> MissionStore:
        data.attrs = {**CONVENTIONS, READER_VERSION: IMPORT_VERSION, **attributes}
        return MissionStore(write_store(data, tmp_path / name))

    one = ("mission", np.array([7.0]))
    real = xr.Dataset(
        {
            "deployment": ("mission", np.array(["unit334"], object)),
            "start_time": ("mission", np.array(["2023-09-20T14:43:20"], "datetime64[ns]")),
            "dive": one,
            "start_latitude": ("mission", np.array([49.57])),
            "start_longitude": ("mission", np.array([-57.9515])),
        }
    )
    logged_at_sea = {"comment": "Recorded by vehicles at sea.", "source_format": "slocum"}
    assert mission_caption(written("real.zarr", real, **logged_at_sea), 0) == (
        "unit334, mission 0, dive 7, 2023-09-20 14:43 UTC, 49.570°N 57.952°W"
    )
    settings = json.dumps({"preset": "field", "seed": 3})
    made = written("d.zarr", xr.Dataset(), settings=settings)
    assert mission_caption(made, 4) == "d.zarr, mission 4, preset field, seed 3, simulated"
    bare = written("bare.zarr", xr.Dataset())
    assert mission_caption(bare, 0) == "bare.zarr, mission 0, simulated"
    assert place(-12.5, 190.0) == "12.500°S 170.000°W"


def test_a_caption_of_dives_tells_the_end_of_the_last(tmp_path):
    data = xr.Dataset(
        {
            "deployment": ("mission", np.array(["unit334"] * 2, object)),
            "start_time": (
                "mission",
                np.array(["2023-09-20T14:43:20", "2023-09-20T18:00"], "datetime64[ns]"),
            ),
            "dive_duration": ("mission", np.array([3600.0, 6.5 * 3600.0])),
        },
        attrs={
            **CONVENTIONS,
            READER_VERSION: IMPORT_VERSION,
            "comment": "Recorded at sea.",
            "source_format": "slocum",
        },
    )
    store = MissionStore(write_store(data, tmp_path / "real.zarr"))
    assert missions_caption(store, [0, 1], None) == (
        "unit334, missions 0 to 1, 2023-09-20 14:43 to 2023-09-21 00:30 UTC"
    )


@pytest.mark.parametrize("by_hand", [False, True])
def test_a_caption_lies_above_everything(by_hand):
    with style.styled():
        figure = style.new_figure(3.5, 3.0)
        if by_hand:
            axes = space_axes(figure, floor=10.0, unit="m", top=0.9)
        else:
            axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], label="a line")
        figure.legend(loc="upper left" if by_hand else "outside upper left")
        add_caption(figure, "unit334, mission 0, dive 7, 2023-09-20 14:43 UTC, 49.570°N 57.952°W")
    figure.draw_without_rendering()
    (text,) = [t for t in figure.texts if "unit334" in t.get_text()]
    caption = text.get_window_extent()
    assert caption.x1 <= figure.bbox.x1
    legend = figure.legends[0].get_window_extent()
    assert legend.y1 <= caption.y0 + 2.0
    assert by_hand or axes.get_window_extent().y1 <= legend.y0 + 2.0
    assert axes.get_window_extent().y1 <= caption.y0


def test_the_twin_is_drawn_over_the_log_on_its_clock():
    log = logged(measured_fin=np.zeros(900))
    time = np.arange(100.0, 700.0, 1.0)
    twin = Trajectory(
        time=time,
        signals={
            "measured_depth": 10.0 + time / 10.0,
            "measured_pitch": np.full(len(time), -40.0),
            "measured_heading": np.full(len(time), 5.0),
            "measured_rotation": np.full(len(time), 12.0),
        },
        states=np.zeros((0, 0)),
    )
    figure = log_figure(log, beside=twin)
    lines = {
        axes.get_title(loc="left"): {line.get_label(): line for line in axes.get_lines()}
        for axes in figure.axes
    }
    assert lines["depth"]["twin"].get_xdata()[0] == pytest.approx(100.0 / 60.0)
    assert lines["depth"]["log"].get_ydata()[0] == pytest.approx(log["measured_depth"][0])
    assert set(lines["pitch"]) == {"log", "twin"}
    assert "log" not in lines["battery rotation"]
    assert "twin" not in lines["rudder"]
    pitch = next(a for a in figure.axes if a.get_title(loc="left") == "pitch")
    assert pitch.get_ylim()[0] < -40.0
    heading = lines["heading from true north"]
    assert abs(heading["twin"].get_ydata()[0] - np.nanmean(heading["log"].get_ydata())) < 90.0
