"""Map and water: coast, graticule, scale bar, TS diagram, sections, colour maps of the ocean."""

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

from twin.errors import InputError
from twin.show.figures import figure, section_figure
from twin.show.figures.map import joined
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
from twin.show.figures.water import OCEAN_MAPS, ocean_map


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
