"""Fixes of LRAUVs: latitude and longitude are two channels, logged milliseconds apart."""

import numpy as np

from factory.importing import Channel, Tally
from glider_twin_protocols.lrauv_reader import _fixes


def test_each_latitude_has_the_longitude_of_its_own_moment():
    """The nearest in time, before or after; a latitude alone for 2 s and more is no fix."""
    latitude = Channel(np.array([10.0, 20.0, 30.0, 40.0]), np.array([36.1, 36.2, 36.3, 36.4]))
    at = [8.5, 10.03, 11.4, 19.97, 21.5, 43.0]
    longitude = Channel(np.array(at), np.array([-122.9, -122.1, -122.8, -122.2, -122.7, -122.6]))
    tally = Tally()
    found = _fixes(latitude, longitude, tally)
    assert found.time.tolist() == [10.0, 20.0]
    np.testing.assert_allclose(found.latitude, [36.1, 36.2])
    np.testing.assert_allclose(found.longitude, [-122.1, -122.2])
    (entry,) = tally.entries()
    assert (entry.action, entry.subject, entry.count) == ("removed", "GPS fixes", 2)
