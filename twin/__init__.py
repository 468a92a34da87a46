"""Twin of an underwater glider: MuJoCo physics, currents, control, sensors and the data schema.

    import twin

    run = twin.simulate(current="uniform:0.1,0")
    run["true_surge"]            # [m/s] an array, as in a mapping
    run.plot().savefig("run.png")

Every public name is imported when it is first used.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places
from twin.version import __version__

if TYPE_CHECKING:
    from twin import bounded as bounded
    from twin import errors as errors
    from twin import frames as frames
    from twin import geodesy as geodesy
    from twin import lazy as lazy
    from twin import numbers as numbers
    from twin import registry as registry
    from twin.checks.agreement import check_manoeuvres as check_manoeuvres
    from twin.checks.agreement import check_published as check_published
    from twin.facade import scenario_of as scenario_of
    from twin.facade import simulate as simulate
    from twin.faults import parse_faults as parse_faults
    from twin.logs.flight_estimate import estimate_flight as estimate_flight
    from twin.mission.controller import Command as Command
    from twin.mission.controller import Observation as Observation
    from twin.mission.controller import Schedule as Schedule
    from twin.mission.plan import Mission as Mission
    from twin.mission.segments import Circle as Circle
    from twin.mission.segments import Hold as Hold
    from twin.mission.segments import Hover as Hover
    from twin.mission.segments import LawnMower as LawnMower
    from twin.mission.segments import SawTooth as SawTooth
    from twin.mission.segments import Spiral as Spiral
    from twin.mission.segments import Surface as Surface
    from twin.mission.segments import Transect as Transect
    from twin.mission.segments import Waypoint as Waypoint
    from twin.mission.shipped_missions import load_mission as load_mission
    from twin.mission.shipped_missions import mission_names as mission_names
    from twin.navigation.settings import Navigation as Navigation
    from twin.physics.fleet import SteppedVehicle as SteppedVehicle
    from twin.physics.outcome import remarks as remarks
    from twin.physics.scenario import Scenario as Scenario
    from twin.physics.scenario import Start as Start
    from twin.physics.settle import trim as trim
    from twin.physics.simulation import Simulation as Simulation
    from twin.physics.simulation import simulate_many as simulate_many
    from twin.physics.start import out_of_trim as out_of_trim
    from twin.records.store import open_store as open_store
    from twin.records.store import open_trajectory as open_trajectory
    from twin.records.timeseries import resample as resample
    from twin.records.timeseries import timeseries as timeseries
    from twin.records.trajectory import Trajectory as Trajectory
    from twin.sensors.suite import SensorSuite as SensorSuite
    from twin.show.figures.base import figure as figure
    from twin.show.figures.base import figure_names as figure_names
    from twin.vehicle.presets import vehicle_names as vehicle_names
    from twin.vehicle.vehicle import Vehicle as Vehicle
    from twin.vehicle.vehicle import load_vehicle as load_vehicle
    from twin.water.current.axes import Origin as Origin
    from twin.water.current.base import parse_current as parse_current
    from twin.water.current.grid import Grid as Grid
    from twin.water.current.layers import Ekman as Ekman
    from twin.water.current.layers import Geostrophic as Geostrophic
    from twin.water.current.layers import LogLayer as LogLayer
    from twin.water.current.profile import Profile as Profile
    from twin.water.current.profile import Uniform as Uniform
    from twin.water.current.series import GaussMarkov as GaussMarkov
    from twin.water.current.series import Series as Series
    from twin.water.current.tide import Inertial as Inertial
    from twin.water.current.tide import Tide as Tide
    from twin.water.density import DensityProfile as DensityProfile
    from twin.water.density import parse_density as parse_density
    from twin.water.floor import Bathymetry as Bathymetry
    from twin.water.floor import FlatFloor as FlatFloor
    from twin.water.floor import GridFloor as GridFloor
    from twin.water.floor import RoughFloor as RoughFloor
    from twin.water.floor import parse_floor as parse_floor

_PLACES = places(__name__)
__all__ = [*_PLACES, "__version__"]
__getattr__, __dir__ = attach(__name__, _PLACES)
