"""Flight: speed, vertical water velocity, currents and corrected tracks from a vehicle's logs.

found = estimate_flight("real.zarr", vehicle="mine.xml")
found.summary().w_deviation
flight_dataset(found)["w_water"]
"""

from twin.flight.current import DiveCurrent
from twin.flight.dataset import flight_dataset, write_flight
from twin.flight.fixes import Fixes
from twin.flight.flight import Flight, FlownMission, estimate_flight
from twin.flight.logged_trajectory import logged_trajectory
from twin.flight.summary import FlightSummary
from twin.flight.thermal_lag import ThermalLag
from twin.flight.track import Drift, corrected_track, linear_track

__all__ = [
    "DiveCurrent",
    "Drift",
    "Fixes",
    "Flight",
    "FlightSummary",
    "FlownMission",
    "ThermalLag",
    "corrected_track",
    "estimate_flight",
    "flight_dataset",
    "linear_track",
    "logged_trajectory",
    "write_flight",
]
