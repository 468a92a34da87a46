"""Metres and degrees: round trips, and the geodesics and tangent planes of another library."""

import numpy as np
import pymap3d
import pymap3d.rcurve
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymap3d.vincenty import vdist, vreckon

from twin.geodesy import (
    convergence,
    from_tangent_plane,
    meridian_radius,
    normal_radius,
    offset,
    position,
    to_tangent_plane,
    turn,
)

LATITUDES = st.floats(-75.0, 75.0)


@given(LATITUDES)
def test_radii_are_those_of_the_ellipsoid(latitude):
    assert meridian_radius(latitude) == pytest.approx(pymap3d.rcurve.meridian(latitude), rel=1e-14)
    assert normal_radius(latitude) == pytest.approx(pymap3d.rcurve.transverse(latitude), rel=1e-14)
    tangent = np.tan(np.radians(latitude))
    assert convergence(latitude) == pytest.approx(tangent / normal_radius(latitude), rel=1e-12)


def test_a_degree_is_as_long_as_tables_say():
    """Of latitude at the equator, at 45 degree and at the pole; of longitude at the equator."""
    for south, metres in ((0.0, 110574.0), (44.5, 111132.0), (89.0, 111694.0)):
        north, _ = offset(np.float64(south + 1.0), np.float64(0.0), south, 0.0)
        assert float(north) == pytest.approx(metres, abs=1.0)
    _, east = offset(np.float64(0.0), np.float64(1.0), 0.0, 0.0)
    assert float(east) == pytest.approx(111319.5, abs=0.1)


@given(LATITUDES, st.floats(-180.0, 180.0), st.floats(0.0, 360.0), st.floats(1.0, 20e3))
def test_distances_are_those_of_the_geodesic(latitude, longitude, bearing, far):
    angle = np.radians(bearing)
    there = position(far * np.cos(angle), far * np.sin(angle), latitude, longitude)
    north, east = offset(np.float64(there[0]), np.float64(there[1]), latitude, longitude)
    geodesic, _ = vdist(latitude, longitude, *there)
    # what a formula of the middle latitude leaves out: the meridians' convergence, squared
    convergence = far / 6.36e6 / np.cos(np.radians(latitude))
    close = pytest.approx(float(geodesic), rel=convergence**2 / 20.0, abs=1e-3)
    assert float(np.hypot(north, east)) == close


@given(LATITUDES, st.floats(-20e3, 20e3), st.floats(-20e3, 20e3))
def test_metres_to_degrees_and_back(latitude, north, east):
    there = position(np.array([north]), np.array([east]), latitude, 179.95)  # over the date line
    back = offset(*there, latitude, 179.95)
    far = np.hypot(north, east) / 20e3
    assert np.hypot(back[0] - north, back[1] - east)[0] < 0.5 * far**2 + 1e-6


@given(LATITUDES, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_degrees_to_metres_and_back(latitude, up, right):
    metres = offset(np.array([latitude + up]), np.array([10.0 + right]), latitude, 10.0)
    back = position(*metres, latitude, 10.0)
    assert back[0] == pytest.approx(latitude + up, abs=4e-6)
    assert back[1] == pytest.approx(10.0 + right, abs=4e-6)


@given(st.floats(-85.0, 85.0), st.floats(-180.0, 180.0), st.floats(-3e5, 3e5), st.floats(-3e5, 3e5))
def test_tangent_planes_are_those_of_pymap3d(latitude, longitude, north, east):
    there = from_tangent_plane(np.array([north]), np.array([east]), latitude, longitude)
    exact = pymap3d.ned2geodetic(north, east, 0.0, latitude, longitude, 0.0)
    metres = 111e3  # [m] in a degree
    off = (there[1][0] - exact[1] + 180.0) % 360.0 - 180.0
    assert abs(there[0][0] - exact[0]) * metres < 1e-3
    assert abs(off) * metres * np.cos(np.radians(latitude)) < 1e-3
    back = to_tangent_plane(float(there[0][0]), float(there[1][0]), latitude, longitude)
    assert back == pytest.approx((north, east), abs=1e-3)


def test_a_place_far_off_in_the_plane_is_where_the_geodesic_ends():
    """86 km at 75 degree, where the meridians converge quickly; the plane is 4 m longer there."""
    for bearing in np.arange(0.0, 360.0, 30.0):
        n, e = 86e3 * np.cos(np.radians(bearing)), 86e3 * np.sin(np.radians(bearing))
        there = from_tangent_plane(np.array([n]), np.array([e]), 75.0, 20.0)
        end = vreckon(75.0, 20.0, 86e3, bearing)
        apart, _ = vdist(*(float(value[0]) for value in there), *(float(v) for v in end))
        assert apart < 86e3**3 / (3.0 * 6.36e6**2) + 0.5


@given(st.floats(-70, 70), st.floats(-15e3, 15e3), st.floats(-15e3, 15e3))
def test_offsets_add_up_a_course_by_the_compass(latitude, north, east):
    """A straight course in many short steps, each on the plane that touches the Earth there."""
    steps = 50
    at = (latitude, 179.95)  # across the date line
    for _ in range(steps):
        place = from_tangent_plane(np.array([north / steps]), np.array([east / steps]), *at)
        at = float(place[0][0]), float(place[1][0])
    back = offset(np.float64(at[0]), np.float64(at[1]), latitude, 179.95)
    assert float(back[0]) == pytest.approx(north, abs=2.0)
    assert float(back[1]) == pytest.approx(east, abs=2.0)


def test_magnetic_axes_turn_by_the_variation():
    """A vector to magnetic north points to the bearing of the variation."""
    north, east = turn(np.array([0.0]), np.array([1.0]), 30.0)
    assert np.degrees(np.arctan2(east[0], north[0])) == pytest.approx(30.0)
    north, east = turn(np.array([1.0]), np.array([0.0]), 30.0)
    assert np.degrees(np.arctan2(east[0], north[0])) == pytest.approx(120.0)
