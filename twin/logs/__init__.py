"""Flight: speed, vertical water velocity, currents and corrected tracks from a vehicle's logs.

found = estimate_flight("real.zarr", vehicle="mine.xml")
found.summary().w_deviation
flight_dataset(found)["w_water"]
"""

from twin.logs.corrected_track import Drift, corrected_track, linear_track
from twin.logs.depth_averaged_current import DiveCurrent
from twin.logs.fix import Fixes
from twin.logs.flight_dataset import flight_dataset, write_flight
from twin.logs.flight_estimate import Flight, MissionFlight, estimate_flight
from twin.logs.flight_summary import FlightSummary
from twin.logs.logged_mission import logged_trajectory
from twin.logs.thermal_lag import ThermalLag

__all__ = [
    "DiveCurrent",
    "Drift",
    "Fixes",
    "Flight",
    "FlightSummary",
    "MissionFlight",
    "ThermalLag",
    "corrected_track",
    "estimate_flight",
    "flight_dataset",
    "linear_track",
    "logged_trajectory",
    "write_flight",
]
