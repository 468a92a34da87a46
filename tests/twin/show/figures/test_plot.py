"""Figures: every one a Figure with units on its axes, from truth or measurements; the command."""

import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure
from pictures import (
    call,
    dead_reckoned,
    refused,
    short_scenario,
    write_tracks,
)

from twin.errors import InputError
from twin.physics.simulation import simulate
from twin.records.mission_dataset import dataset_of
from twin.records.store import read_trajectory, write_store
from twin.records.tracks import NamedTrack
from twin.show.figures import (
    FIGURES,
    section_figure,
    sensor_figure,
    track_3d_figure,
    track_figure,
)
from twin.show.figures import figure as draw_figure
from twin.show.figures.map import KEY_ID, LOCATOR_ID
from twin.show.figures.signals import truth_of
from twin.show.figures.water import mean_profile

WITH_TRACKS = tuple(name for name, kind in FIGURES.items() if kind.takes_tracks)


def has_unit(label):
    """Whether it says a unit; the ticks of a map say degrees themselves."""
    return label in ("latitude", "longitude") or ("[" in label and label.rstrip().endswith("]"))


def drawn_axes(figure):
    """Axes that hold data; a map has a small one and a key beside it."""
    beside = (LOCATOR_ID, KEY_ID)
    return [a for a in figure.axes if (a.lines or a.collections) and a.get_gid() not in beside]


def check_units(figure):
    """Each axis of each panel has a unit, its own or that of the axis it shares."""
    assert drawn_axes(figure)
    for axes in drawn_axes(figure):
        shared = axes.get_shared_x_axes().get_siblings(axes)
        assert any(has_unit(a.get_xlabel()) for a in shared) or not axes.xaxis.get_visible() or (
            axes.get_label() == "<colorbar>"
        )  # fmt: skip
        assert has_unit(axes.get_ylabel())
        if hasattr(axes, "get_zlabel"):
            assert has_unit(axes.get_zlabel())


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_has_units_on_its_axes(trajectory, name):
    figure = draw_figure(trajectory, name)
    assert isinstance(figure, Figure)
    check_units(figure)
    if FIGURES[name].takes_tracks:
        check_units(draw_figure(trajectory, name, tracks=dead_reckoned(trajectory)))


@pytest.mark.parametrize("name", WITH_TRACKS)
@pytest.mark.parametrize("count", [1, 2, 10])
def test_the_names_of_tracks_stay_inside_the_page(trajectory, name, count):
    time = trajectory.time
    tracks = [
        NamedTrack(
            name="pitch_plus_alpha_corrected"[: 8 + 2 * k],
            time=time,
            north=trajectory["true_north"] + k,
            east=trajectory["true_east"],
        )
        for k in range(count)
    ]
    figure = draw_figure(trajectory, name, tracks=tracks)
    figure.canvas.draw()
    legends = [*figure.legends, *(legend for sub in figure.subfigs for legend in sub.legends)]
    (legend,) = legends
    box = legend.get_window_extent()
    width, height = figure.get_size_inches() * figure.dpi
    assert box.x0 >= 0
    assert box.x1 <= width
    assert box.y1 <= height
    texts = [text.get_text() for text in legend.get_texts()]
    assert {track.title for track in tracks} <= set(texts)
    assert not any("_" in text for text in texts)


def test_sections_run_down(trajectory):
    for colour in ("speed", "current", "density", "net_mass", "pitch"):
        figure = section_figure(trajectory, colour)
        bottom, top = figure.axes[0].get_ylim()
        assert bottom > trajectory["true_depth"].max() > 0 >= top
    with pytest.raises(InputError, match="did you mean 'density'"):
        section_figure(trajectory, "densty")


def test_a_section_shows_a_floor_that_is_near(trajectory):
    deepest = float(trajectory["true_depth"].max())

    def bottom_of(floor):
        altitude = floor - trajectory["true_depth"]
        above = dataclasses.replace(
            trajectory, signals={**trajectory.signals, "true_altitude": altitude}
        )
        axes = section_figure(above).axes[0]
        (ground,) = (c for c in axes.collections if len(c.get_facecolor()))
        assert ground.get_paths()[0].vertices[:, 1].min() == pytest.approx(floor)
        return axes.get_ylim()[0]

    plain = section_figure(trajectory).axes[0].get_ylim()[0]
    assert bottom_of(1.2 * deepest) == pytest.approx(1.2 * plain)
    assert bottom_of(40.0 * deepest) == pytest.approx(1.5 * plain)  # an abyss flattens nothing


def test_tracks_have_equal_scales_and_show_the_data(trajectory):
    figure = track_figure(trajectory, dead_reckoned(trajectory))
    axes = figure.axes[0]
    assert axes.get_aspect() == 1.0
    truth = axes.lines[0]
    np.testing.assert_allclose(truth.get_xdata(), trajectory["true_east"])
    np.testing.assert_allclose(truth.get_ydata(), trajectory["true_north"])
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.lines[:3]}
    assert len(looks) == 3


def test_the_track_in_space_goes_down(trajectory):
    axes = track_3d_figure(trajectory).axes[0]
    low, high = axes.get_zlim()
    assert low > high == 0.0


def test_the_mean_profile_is_the_mean():
    depth = np.linspace(0.0, 80.0, 8001)
    centres, (mean,) = mean_profile(depth, 0.3 - 0.002 * depth)
    np.testing.assert_allclose(mean, 0.3 - 0.002 * centres, atol=1e-4)


def test_sensors_against_truth(trajectory):
    figure = sensor_figure(trajectory, ("depth", "heading", "dvl_surge", "gps_north"))
    left, right = figure.axes[0], figure.axes[1]
    true, noisy = (line.get_ydata() for line in left.lines)
    np.testing.assert_allclose(true, trajectory["true_depth"])
    np.testing.assert_allclose(right.lines[-1].get_ydata(), noisy - true)
    assert figure.axes[7].get_title(loc="left").startswith("measured − true: mean")
    with pytest.raises(InputError, match="unknown measured signal 'smell'"):
        sensor_figure(trajectory, ("smell",))
    with pytest.raises(InputError, match="no measured signals"):
        sensor_figure(simulate(short_scenario()))


def test_a_dvl_is_judged_by_what_it_sees(trajectory):
    seen = truth_of("dvl_surge", trajectory)
    count = len(trajectory.time)
    water = trajectory["true_surge"]
    np.testing.assert_array_equal(seen[: count // 2], water[: count // 2])
    assert np.abs(seen - water)[count // 2 :].max() > 0.02  # over ground: the current is in it
    assert truth_of("dvl_mode", trajectory) is None


def test_all_figures_go_into_a_folder(capsys, store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("twin.commands.plot.PRINT_DPI", 40)
    few = {name: FIGURES[name] for name in ("track", "track_3d", "sensor")}
    monkeypatch.setattr("twin.commands.plot.FIGURES", few)
    code, out, err = call(capsys, "plot", store, "--mission", 1, "--figure", "all")
    assert (code, err) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["plots"]
    assert {path.stem for path in (tmp_path / "plots").iterdir()} == set(few)
    assert all(path.stat().st_size > 2000 for path in (tmp_path / "plots").iterdir())
    assert len(out.splitlines()) == len(few)


def test_one_figure_with_tracks(capsys, store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tracks = write_tracks(tmp_path / "tracks.npz", read_trajectory(store))
    words = ("plot", store, "--figure", "track", "--tracks", tracks)
    assert call(capsys, *words)[0] == 0
    assert (tmp_path / "track.png").is_file()
    assert call(capsys, *words, "--only", "network", "--out", "new/one.svg")[0] == 0
    text = (tmp_path / "new" / "one.svg").read_text()
    assert "network" in text
    assert "steady flight" not in text


def test_a_mission_without_sensors_says_so(capsys, tmp_path, trajectory, monkeypatch):
    few = {name: FIGURES[name] for name in ("section", "sensor", "current")}
    monkeypatch.setattr("twin.commands.plot.FIGURES", few)
    names = [n for n in trajectory.signals if not n.startswith(("measured", "true_current"))]
    bare = dataclasses.replace(trajectory, signals={n: trajectory[n] for n in names})
    path = write_store(dataset_of([bare]), tmp_path / "bare.zarr")
    code, _, err = call(capsys, "plot", path, "--figure", "all", "--out", tmp_path / "all")
    assert code == 0
    assert "this trajectory has no measured signals" in err
    assert "no current figure: mission 0 of" in err
    told = refused(capsys, "plot", path, "--figure", "current", "--out", tmp_path / "c.png")
    assert "has no signal true_current_" in told


def test_tracks_for_a_figure_without_them_are_refused(capsys, store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tracks = write_tracks(tmp_path / "tracks.npz", read_trajectory(store))
    told = refused(capsys, "plot", store, "--figure", "section", "--tracks", tracks)
    assert "the section figure draws no tracks; these do: overview, track, track_3d" in told


@pytest.mark.parametrize("command", ["plot", "render"])
def test_the_help_says_that_pictures_are_replaced_and_names_every_figure(capsys, command):
    code, out, _ = call(capsys, command, "--help")
    assert code == 0
    assert "replaced without asking" in " ".join(out.replace("\u2502", "").split())
    assert command == "render" or all(name in out for name in FIGURES)
