"""Logs: velocity, vertical water velocity, currents and corrected tracks of a whole store of logs.

found = estimate_flight("real.zarr", vehicle="mine.xml")
found.summary().w_deviation
flight_dataset(found)["w_water"]
"""

from twin.logs.corrected_track import DiveCurrent as DiveCurrent
from twin.logs.corrected_track import Drift as Drift
from twin.logs.corrected_track import corrected_track as corrected_track
from twin.logs.corrected_track import linear_track as linear_track
from twin.logs.corrected_track import track_velocity as track_velocity
from twin.logs.energy_use import Endurance as Endurance
from twin.logs.energy_use import EnergyUse as EnergyUse
from twin.logs.energy_use import counted_energy as counted_energy
from twin.logs.energy_use import endurance_of as endurance_of
from twin.logs.energy_use import energy_used as energy_used
from twin.logs.energy_use import second_half as second_half
from twin.logs.flight_dataset import DAC as DAC
from twin.logs.flight_dataset import EPOCH as EPOCH
from twin.logs.flight_dataset import OF_DIVES as OF_DIVES
from twin.logs.flight_dataset import PER_DIVE as PER_DIVE
from twin.logs.flight_dataset import check_target as check_target
from twin.logs.flight_dataset import flight_dataset as flight_dataset
from twin.logs.flight_dataset import write_flight as write_flight
from twin.logs.flight_estimate import Flight as Flight
from twin.logs.flight_estimate import MissionFlight as MissionFlight
from twin.logs.flight_estimate import estimate_flight as estimate_flight
from twin.logs.flight_summary import FlightSummary as FlightSummary
from twin.logs.flight_summary import summarise as summarise
from twin.logs.logged_mission import logged_trajectory as logged_trajectory
from twin.logs.thermal_lag import ThermalLag as ThermalLag
from twin.logs.track import Fixes as Fixes
from twin.logs.track import fixes_at as fixes_at
from twin.logs.track import place_of as place_of
