"""Figures: units on their axes, from truth or measurements; map, coast and water; the command."""

import dataclasses

import gsw
import matplotlib
import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.quiver import Quiver
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
    figure,
    section_figure,
    sensor_figure,
    track_3d_figure,
    track_figure,
)
from twin.show.figures import figure as draw_figure
from twin.show.figures.map import KEY_ID, LOCATOR_ID, joined
from twin.show.figures.map_ground import (
    STEPS,
    box_around,
    coast_within,
    draw_graticule,
    draw_land,
    draw_scale_bar,
    land_within,
    latitude_text,
    line_step,
    longitude_text,
    rings,
)
from twin.show.figures.signals import truth_of
from twin.show.figures.water import OCEAN_MAPS, mean_profile, ocean_map

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


@pytest.mark.parametrize("sideways", [False, True])
def test_an_overview_has_a_current_over_time_where_it_changes_sideways(trajectory, sideways):
    """Against depth it would be a zigzag; uniform water and water of layers are a profile."""
    time = trajectory.time / trajectory.time[-1]
    depth = 30.0 * np.abs(np.sin(12.0 * time))  # four dives
    current = 0.1 * np.cos(6.0 * time) if sideways else 0.1 * np.exp(-depth / 30.0)
    signals = {"true_current_north": current, "true_current_east": 0.0 * current}
    signals["true_depth"] = depth
    changed = dataclasses.replace(trajectory, signals={**trajectory.signals, **signals})
    (axes,) = (
        axes for axes in draw_figure(changed, "overview").axes
        if "current met on the way" in (axes.get_title(), axes.get_title("left"))
    )  # fmt: skip
    horizontal, vertical = axes.get_xlabel(), axes.get_ylabel()
    if sideways:
        assert horizontal.startswith("time")
        assert vertical == "current [m/s]"
    else:
        assert horizontal == "current [m/s]"
        assert vertical.startswith("depth")


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
        assert max(ground.get_linewidths()) == 0.0  # an edge would raise the floor
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


# --- map and water --------------------------------------------------------------------------------


def on_land(latitude: float, longitude: float) -> bool:
    found = land_within(longitude - 0.1, longitude + 0.1, latitude - 0.1, latitude + 0.1)
    return sum(Path(ring).contains_point((longitude, latitude)) for ring in found) % 2 == 1


@pytest.mark.parametrize(
    ("latitude", "longitude", "land"),
    [
        (48.85, 2.35, True),  # Paris
        (-33.5, 149.0, True),  # west of Sydney
        (67.0, -175.0, True),  # Chukotka, beyond the date line
        (67.0, 185.0, True),  # the same place, counted on
        (30.0, -40.0, False),  # the Atlantic
        (42.0, 50.5, False),  # the Caspian Sea, a hole of the land
        (0.0, 180.0, False),
        (-85.0, 179.9, True),  # Antarctica
        (-85.0, 0.0, True),
        (-65.0, 100.0, False),
    ],
)
def test_the_coast_parts_land_and_sea(latitude, longitude, land):
    assert on_land(latitude, longitude) is land


def test_the_coast_is_closed_and_lies_on_the_earth():
    assert len(rings()) == 1421
    for ring in rings():
        assert (ring[0] == ring[-1]).all()
        assert (np.abs(ring) <= (360.0, 90.001)).all()
        assert np.abs(np.diff(ring[:, 0]))[np.abs(ring[1:, 1]) < 89.0].max(initial=0.0) < 20.0


def test_the_open_ocean_has_no_coast():
    assert coast_within(-6.5, -5.0, 49.5, 50.5)
    assert not coast_within(-41.0, -39.0, 29.0, 31.0)
    axes = Figure().add_subplot()
    draw_land(axes, (-41.0, -39.0, 29.0, 31.0))
    corners = [(x, y) for x in (-41.0, -39.0) for y in (29.0, 31.0)]
    for land in axes.collections:  # the box of a continent's bounds may reach here
        (path,) = land.get_paths()
        assert not path.contains_points(corners).any()


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [
        (49.5, 10.0, "49°30′N"),
        (-49.5, 10.0, "49°30′S"),
        (0.0, 10.0, "0°00′"),
        (12.0, 60.0, "12°N"),
        (12.0 + 7.25 / 60.0, 0.05, "12°07.25′N"),
        (49.99999, 1.0, "50°00′N"),
    ],
)
def test_latitudes_read_as_on_charts(value, step, text):
    assert latitude_text(value, step) == text


def test_longitudes_turn_at_180():
    assert longitude_text(-58.25, 5.0) == "58°15′W"
    assert longitude_text(190.0, 60.0) == "170°W"
    assert longitude_text(180.0, 60.0) == "180°"
    np.testing.assert_allclose(joined(np.array([179.0, np.nan, -179.0])), [179.0, np.nan, 181.0])


@given(span=st.floats(0.004, 100.0), most=st.integers(2, 6))
def test_lines_of_a_map_are_few_and_round(span, most):
    step = line_step(span, most)
    assert step in STEPS
    assert 60.0 * span / step <= most or step == STEPS[-1]


@given(
    latitude=st.floats(-75.0, 75.0),
    longitude=st.floats(-179.0, 179.0),
    north=st.floats(0.0, 2.0),
    east=st.floats(0.0, 2.0),
    shape=st.floats(0.5, 2.0),
)
def test_a_box_holds_its_points_and_has_its_shape(latitude, longitude, north, east, shape):
    points = np.array([latitude, latitude + north]), np.array([longitude, longitude + east])
    west, far, south, top = box_around(*points, shape)
    assert west < longitude
    assert far > longitude + east
    assert south < latitude
    assert top > latitude + north
    middle = np.radians(0.5 * (south + top))
    assert (far - west) * np.cos(middle) / (top - south) == pytest.approx(shape, rel=0.01)


def test_the_scale_bar_is_as_long_as_it_says():
    axes = Figure().add_subplot()
    box = (-6.0, -5.0, 49.5, 50.2)
    draw_graticule(axes, box)
    metres = draw_scale_bar(axes, box)
    west, east = axes.lines[-1].get_xdata()
    long = pymap3d.geodetic2enu(49.85, east, 0.0, 49.85, west, 0.0)[0]
    assert float(long) == pytest.approx(metres, rel=1e-3)
    assert axes.texts[0].get_text() == f"{metres / 1000:g} km"


def test_the_map_has_coordinates_and_the_true_track(trajectory):
    drawn = figure(trajectory, "map")
    drawn.canvas.draw()
    axes = drawn.axes[0]
    latitude, longitude = trajectory.geographic_position()
    (track,) = [line for line in axes.lines if line.get_label() == "true track"]
    np.testing.assert_allclose(track.get_xdata(), longitude)
    np.testing.assert_allclose(track.get_ydata(), latitude)
    texts = [t.get_text() for t in axes.get_yticklabels()]
    assert texts
    assert all("°" in text and text.endswith("N") for text in texts)
    (fixes,) = [line for line in axes.lines if line.get_label() == "GPS fix"]
    fixed = np.isfinite(trajectory["measured_gps_north"])
    north = np.radians(fixes.get_ydata() - latitude[fixed]) * 6_371_000.0
    np.testing.assert_allclose(north, 3.0, atol=0.01)
    (arrows,) = [c for c in axes.collections if isinstance(c, Quiver)]
    assert np.hypot(arrows.U, arrows.V).max() <= np.hypot(0.25, 0.15)
    said = [text.get_text() for one in drawn.axes for text in one.texts]
    assert "true current, mean of\neach dive" in said
    assert any(text.endswith(" cm/s") for text in said)
    locator = drawn.axes[1]
    assert any(c.get_gid() == "land" for c in locator.collections)  # Cornwall is near
    width, height = drawn.get_size_inches() * drawn.dpi
    for one in drawn.axes:
        box = one.get_tightbbox()
        assert box.x0 >= -1
        assert box.y0 >= -1
        assert box.x1 <= width + 1
        assert box.y1 <= height + 1


def test_a_mission_without_a_place_has_no_map(trajectory):
    nowhere = dataclasses.replace(trajectory, provenance={})
    with pytest.raises(InputError, match="the track figure draws it in metres"):
        figure(nowhere, "map")


def test_the_ts_diagram_is_teos_10(trajectory):
    axes = figure(trajectory, "ts").axes[0]
    (dots,) = [c for c in axes.collections if len(c.get_offsets()) > 10]
    depth = trajectory["true_depth"]
    pressure = np.maximum(gsw.p_from_z(-np.maximum(depth, 0.0), 49.9), 0.0)
    salinity = gsw.SA_from_SP(trajectory["measured_salinity"], pressure, -5.9, 49.9)
    temperature = gsw.CT_from_t(salinity, trajectory["measured_temperature"], pressure)
    np.testing.assert_allclose(dots.get_offsets(), np.column_stack([salinity, temperature]))
    np.testing.assert_allclose(dots.get_array(), depth)
    (contours,) = (c for c in axes.collections if hasattr(c, "levels"))
    assert len(contours.levels) >= 2
    for level, path in zip(contours.levels, contours.get_paths(), strict=True):
        if len(path.vertices):
            np.testing.assert_allclose(gsw.sigma0(*path.vertices.T), level, atol=2e-3)
    assert axes.get_xlabel() == "absolute salinity (measured) [g/kg]"
    nowhere = dataclasses.replace(trajectory, provenance={})
    assert figure(nowhere, "ts").axes[0].get_xlabel().startswith("reference salinity")


def test_sections_of_the_water_run_down_in_cmocean_s_maps(trajectory):
    for name in ("hydrography", "transect"):
        panels = [axes for axes in figure(trajectory, name).axes if axes.get_title(loc="left")]
        for axes, quantity in zip(panels, ("temperature", "salinity"), strict=True):
            (dots,) = axes.collections
            np.testing.assert_allclose(dots.get_array(), trajectory[f"measured_{quantity}"])
            np.testing.assert_allclose(dots.get_offsets()[:, 1], trajectory["true_depth"].clip(0.0))
            bottom, top = axes.get_ylim()
            assert bottom > trajectory["true_depth"].max() > 0.0 == top
            assert dots.get_cmap().name == OCEAN_MAPS[quantity]
    way = np.hypot(np.diff(trajectory["true_north"]), np.diff(trajectory["true_east"])).sum()
    assert dots.get_offsets()[-1, 0] == pytest.approx(way)


def test_a_mission_without_a_ctd_says_so(trajectory):
    dry = {n: v for n, v in trajectory.items() if "temperature" not in n}
    for name in ("ts", "hydrography", "transect"):
        with pytest.raises(InputError, match="no temperature and salinity: a log has them"):
            figure(dataclasses.replace(trajectory, signals=dry), name)


def test_a_section_is_coloured_by_the_water(trajectory):
    axes = section_figure(trajectory, "temperature").axes
    assert axes[0].collections[0].get_cmap().name == "thermal"
    assert axes[1].get_ylabel() == "temperature [°C]"


def test_colour_maps_exist_and_signed_ones_have_a_middle():
    for quantity in OCEAN_MAPS:
        assert ocean_map(quantity).N == 256
    balance = ocean_map("vertical_velocity")
    assert np.mean(balance(0.5)[:3]) > 0.85
    assert isinstance(ocean_map("pitch"), str)
    assert ocean_map("pitch") in matplotlib.colormaps


def test_the_label_below_a_map_with_a_caption_is_whole():
    from twin.show.figures.map import MapContent, draw_content
    from twin.show.figures.page_layout import add_caption

    track = (np.array([48.8, 48.9]), np.array([-130.6, -130.3]))
    figure = draw_content(MapContent(tracks=(track,), name="corrected track"))
    add_caption(figure, "a deployment, " * 8)
    figure.draw_without_rendering()
    assert figure.axes[0].xaxis.label.get_window_extent().y0 > 0.0
