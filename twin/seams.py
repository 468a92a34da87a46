"""Extension points of `twin`: names and import places of the shipped types of each."""

from __future__ import annotations

from typing import Any

from twin.errors import CurrentError, MissionError, VehicleError
from twin.registry import Registry

_FEATURES = (
    "sin_roll cos_roll sin_pitch cos_pitch sin_roll_slow sin_pitch_slow "
    "roll_change pitch_change heading_change "
    "roll_change_slow pitch_change_slow heading_change_slow "
    "roll_rate pitch_rate yaw_rate "
    "specific_force_x specific_force_y specific_force_z "
    "depth_rate depth_rate_slow glide_speed glide_speed_slow "
    "gravity_pitch_sine gravity_glide_speed gravity_glide_speed_slow "
    "depth "
    "shift sin_rotation cos_rotation pump "
    "shift_change rotation_change pump_change "
    "shift_command sin_rotation_command cos_rotation_command pump_command "
    "flight_surge flight_sway flight_attack flight_steady"
)
"""Names of the shipped features, in the order of a network's inputs"""

CURRENTS: Registry[Any] = Registry(
    "current",
    group="glider_twin.currents",
    folder="twin/water/current",
    base="twin.water.current.Current",
    page="reference/currents.md#a-current-of-your-own",
    shipped={
        "uniform": "twin.water.current.profile:Uniform",
        "profile": "twin.water.current.profile:Profile",
        "ekman": "twin.water.current.layers:Ekman",
        "geostrophic": "twin.water.current.layers:Geostrophic",
        "tide": "twin.water.current.tide:Tide",
        "inertial": "twin.water.current.tide:Inertial",
        "log-layer": "twin.water.current.layers:LogLayer",
        "gauss-markov": "twin.water.current.series:GaussMarkov",
        "grid": "twin.water.current.grid:Grid",
        "series": "twin.water.current.series:Series",
    },
    name="kind",
    error=CurrentError,
    compiled=True,
    check_shipped=False,
)
"""Types of current. A class may set `code`, its number in compiled programs."""

SENSORS: Registry[Any] = Registry(
    "sensor",
    group="glider_twin.sensors",
    folder="twin/sensors",
    base="twin.sensors.Sensor",
    page="reference/sensors.md#a-sensor-of-your-own",
    shipped={
        "imu": "twin.sensors.imu:Imu",
        "attitude": "twin.sensors.ahrs:Attitude",
        "compass": "twin.sensors.ahrs:Compass",
        "pressure": "twin.sensors.ctd:Pressure",
        "altimeter": "twin.sensors.altimeter:Altimeter",
        "gps": "twin.sensors.gps:Gps",
        "dvl": "twin.sensors.dvl:Dvl",
        "encoders": "twin.sensors.encoders:Encoders",
        "onboard": "twin.sensors.onboard:Onboard",
        "ctd": "twin.sensors.ctd:Ctd",
    },
)
"""Types of sensor; the shipped sensors are in every suite."""

PARTS: Registry[Any] = Registry(
    "vehicle part",
    group="glider_twin.vehicle_parts",
    folder="twin/vehicle/parts",
    base="twin.vehicle.parts.Part",
    page="howto/extending.md#a-vehicle-part",
    shipped={
        "battery-slide": "twin.vehicle.parts.battery:BatterySlide",
        "battery-hinge": "twin.vehicle.parts.battery:BatteryHinge",
        "pump": "twin.vehicle.parts.pump:Pump",
        "propeller": "twin.vehicle.parts.propeller:Propeller",
        "fin": "twin.vehicle.parts.fin:Fin",
        "drop-weight": "twin.vehicle.parts.pump:DropWeight",
        "thruster": "twin.vehicle.parts.thruster:Thruster",
        "tether": "twin.vehicle.parts.thruster:Tether",
    },
    name="kind",
    words=("unit",),
    error=VehicleError,
    compiled=True,
)
"""Types of part that a vehicle file may name."""

LAWS: Registry[Any] = Registry(
    "hull law",
    group="glider_twin.hull_laws",
    folder="twin/vehicle/laws",
    base="twin.vehicle.laws.HullLaw",
    page="howto/extending.md#a-hull-law",
    shipped={
        "flow-frame": "twin.vehicle.laws.flow_frame:FlowFrame",
        "body-axes": "twin.vehicle.laws.body_axes:BodyAxes",
        "ellipsoid": "twin.vehicle.laws.ellipsoid:Ellipsoids",
    },
    name="kind",
    error=VehicleError,
    compiled=True,
)
"""Hull laws: drag, lift and moments on a hull."""

SEGMENTS: Registry[Any] = Registry(
    "kind of segment",
    group="glider_twin.segments",
    folder="twin/mission/segments",
    base="twin.mission.segments.Segment",
    page="howto/extending.md#a-mission-segment",
    shipped={
        "saw-tooth": "twin.mission.segments.profile:SawTooth",
        "spiral": "twin.mission.segments.profile:Spiral",
        "transect": "twin.mission.segments.level:Transect",
        "circle": "twin.mission.segments.level:Circle",
        "lawn-mower": "twin.mission.segments.level:LawnMower",
        "hover": "twin.mission.segments.station:Hover",
        "waypoint": "twin.mission.segments.waypoint:Waypoint",
        "surface": "twin.mission.segments.station:Surface",
        "hold": "twin.mission.segments.station:Hold",
        "pose": "twin.mission.segments.pose:Pose",
        "orbit": "twin.mission.segments.pose:Orbit",
        "mow": "twin.mission.segments.pose:Mow",
        "sticks": "twin.mission.segments.pose:Sticks",
    },
    name="kind",
    error=MissionError,
)
"""Types of segment of a mission."""

FEATURES: Registry[Any] = Registry(
    "feature",
    group="glider_twin.features",
    folder="twin/navigation/features",
    base="twin.navigation.features.Feature",
    page="howto/extending.md#a-feature",
    shipped={n: f"twin.navigation.features.selection:{n.upper()}" for n in _FEATURES.split()},
    words=("group", "unit"),
    objects=True,
    check_shipped=False,
)
"""Features: inputs of networks, in their order."""

VELOCITY_ESTIMATORS: Registry[Any] = Registry(
    "velocity estimator",
    group="glider_twin.velocity_estimators",
    former="glider_twin.baselines",
    folder="twin/navigation/estimators",
    base="twin.navigation.estimators.VelocityEstimator",
    page="howto/extending.md#a-velocity-estimator",
    shipped={
        "pitch_plus_alpha": "twin.navigation.estimators.flight:PitchPlusAlpha",
        "steady_flight": "twin.navigation.estimators.flight:SteadyFlight",
        "onboard": "twin.navigation.estimators.flight:OnboardReckoning",
        "ekf": "twin.navigation.estimators.ekf:Ekf",
        "flight_filter": "twin.navigation.estimators.flight:LearnedFlight",
        "dvl": "twin.navigation.estimators.dvl:Dvl",
    },
    name="kind",
    words=("summary",),
    check_shipped=False,
)
"""Estimators of velocity through the water: on board, and as baselines to compare networks with."""

FLIGHT_ESTIMATORS: Registry[Any] = Registry(
    "flight estimator",
    group="glider_twin.flight_estimators",
    folder="twin/logs",
    base="twin.logs.flight_estimator.FlightEstimator",
    page="howto/flight.md#an-estimator-of-ones-own",
    shipped={
        "flight": "twin.logs.flight_estimator:FlightModel",
        "steady": "twin.logs.flight_estimator:SteadyModel",
    },
    name="kind",
    words=("summary",),
)
"""Estimators of the velocity through the water in a logged dive."""

FIGURES: Registry[Any] = Registry(
    "figure",
    group="glider_twin.figures",
    folder="twin/show/figures",
    base="twin.show.figures.FigureKind",
    page="howto/render.md#twin-plot",
    shipped={
        "overview": "twin.show.figures.section:WHOLE",
        "track": "twin.show.figures.track:FIGURE",
        "track_3d": "twin.show.figures.track:TRACK_3D",
        "section": "twin.show.figures.section:FIGURE",
        "velocity": "twin.show.figures.signals:VELOCITIES",
        "actuator": "twin.show.figures.signals:ACTUATORS",
        "sensor": "twin.show.figures.signals:SENSOR_FIGURE",
        "current": "twin.show.figures.water:CURRENT",
        "map": "twin.show.figures.map:FIGURE",
        "hydrography": "twin.show.figures.water:HYDROGRAPHY",
        "transect": "twin.show.figures.section:TRANSECT",
        "ts": "twin.show.figures.water:DIAGRAM",
        "log": "twin.show.figures.logged_dive:FIGURE",
    },
    words=("summary",),
    objects=True,
)
"""Figures of one mission, by their names on the command line."""

FAULTS: Registry[Any] = Registry(
    "fault",
    group="glider_twin.faults",
    folder="twin/faults",
    base="twin.faults.Fault",
    page="howto/health.md#a-fault-of-your-own",
    shipped={
        "wing_lost": "twin.faults.hull:WingLost",
        "fouling": "twin.faults.hull:Fouling",
        "attached": "twin.faults.hull:Attached",
        "water_taken": "twin.faults.hull:WaterTaken",
        "pump_weak": "twin.faults.drives:PumpWeak",
        "pump_air": "twin.faults.drives:PumpAir",
        "turn_stuck": "twin.faults.drives:TurnStuck",
        "turn_slips": "twin.faults.drives:TurnSlips",
        "pitch_slips": "twin.faults.drives:PitchSlips",
        "blade_lost": "twin.faults.hull:BladeLost",
        "compass_iron": "twin.faults.instruments:CompassIron",
        "compass_turned": "twin.faults.instruments:CompassTurned",
        "pressure_drift": "twin.faults.instruments:PressureDrift",
        "altimeter_blind": "twin.faults.instruments:AltimeterBlind",
        "ctd_clogged": "twin.faults.instruments:CtdClogged",
        "thermistor_slow": "twin.faults.instruments:ThermistorSlow",
        "dvl_beam": "twin.faults.instruments:DvlBeam",
        "pack_lost": "twin.faults.drives:PackLost",
        "hotel_raised": "twin.faults.drives:HotelRaised",
    },
    name="kind",
    words=("says", "size_name", "source", "shows", "otherwise", "find_out"),
)
"""Types of fault of a vehicle."""

TASKS: Registry[Any] = Registry(
    "task",
    group="glider_twin.tasks",
    folder="twin/control",
    base="twin.control.task.GliderTask",
    page="howto/dm_control.md",
    shipped={
        "hold": "twin.control.hold:hold",
        "depth": "twin.control.hold:depth",
        "waypoints": "twin.control.waypoints:waypoints",
        "energy": "twin.control.waypoints:energy",
        "reach": "twin.control.pose:reach",
        "station": "twin.control.pose:station",
        "path": "twin.control.pose:path",
    },
    name="__name__",
    check="twin.control.registry:check_task",
)
"""Control tasks for dm_control, by name."""

RANDOMISERS: Registry[Any] = Registry(
    "randomiser",
    group="glider_twin.randomisers",
    folder="twin/control",
    base="twin.control.conditions.Randomiser",
    page="howto/dm_control.md#noise-currents-errors",
    check="twin.control.conditions:check_randomiser",
)
"""Samplers of the conditions of a task's episodes."""
