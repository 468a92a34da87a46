"""Signals: name, unit and meaning of each that the twin simulates or an import brings.

`true_*` is what happened, `measured_*` what the sensors said, `commanded_*` what was asked for.
Standard names are CF's where one exists.
"""

from __future__ import annotations

from twin.records.schema.base import Variable

SIGNALS: tuple[Variable, ...] = (
    Variable("true_north", "m", "distance north of the start", comment="over ground"),
    Variable("true_east", "m", "distance east of the start", comment="over ground"),
    Variable("true_depth", "m", "depth of the centre of buoyancy", "depth"),
    Variable(
        "true_roll", "degree", "roll", "platform_roll_starboard_down", comment="starboard down"
    ),
    Variable("true_pitch", "degree", "pitch", "platform_pitch_fore_up", comment="nose up"),
    Variable(
        "true_heading",
        "degree",
        "heading",
        "platform_orientation",
        comment="from true north, clockwise",
    ),
    Variable(
        "true_surge",
        "m s-1",
        "surge velocity through the water",
        comment="forward, forward-starboard-down body axes",
    ),
    Variable(
        "true_sway",
        "m s-1",
        "sway velocity through the water",
        comment="starboard, forward-starboard-down body axes",
    ),
    Variable(
        "true_heave",
        "m s-1",
        "heave velocity through the water",
        comment="down, forward-starboard-down body axes",
    ),
    Variable("true_speed", "m s-1", "speed through the water", "platform_speed_wrt_sea_water"),
    Variable("true_velocity_north", "m s-1", "northward velocity over ground"),
    Variable("true_velocity_east", "m s-1", "eastward velocity over ground"),
    Variable("true_velocity_down", "m s-1", "downward velocity over ground"),
    Variable(
        "true_roll_rate",
        "rad s-1",
        "roll rate",
        comment="angular velocity about the forward body axis",
    ),
    Variable(
        "true_pitch_rate",
        "rad s-1",
        "pitch rate",
        comment="angular velocity about the starboard body axis",
    ),
    Variable(
        "true_yaw_rate",
        "rad s-1",
        "yaw rate",
        comment="angular velocity about the downward body axis",
    ),
    Variable("true_specific_force_x", "m s-2", "forward specific force at the IMU"),
    Variable("true_specific_force_y", "m s-2", "starboard specific force at the IMU"),
    Variable("true_specific_force_z", "m s-2", "downward specific force at the IMU"),
    Variable("true_shift", "m", "battery position", comment="forward of neutral"),
    Variable("true_rotation", "degree", "battery rotation", comment="positive to port"),
    Variable("true_pump", "cm3", "pumped volume", comment="positive makes the vehicle lighter"),
    Variable("true_net_mass", "kg", "net mass", comment="positive is heavy"),
    Variable(
        "true_current_north",
        "m s-1",
        "northward current at the vehicle",
        "northward_sea_water_velocity",
    ),
    Variable(
        "true_current_east",
        "m s-1",
        "eastward current at the vehicle",
        "eastward_sea_water_velocity",
    ),
    Variable("true_current_down", "m s-1", "downward current at the vehicle"),
    Variable("true_density", "kg m-3", "in-situ density at the vehicle", "sea_water_density"),
    Variable("true_immersion", "1", "immersed fraction of the hull"),
    Variable(
        "true_temperature",
        "degree_Celsius",
        "in-situ temperature at the vehicle",
        "sea_water_temperature",
        gaps=True,
        comment="NaN where the water column has only density",
    ),
    Variable(
        "true_salinity",
        "1",
        "practical salinity at the vehicle",
        "sea_water_practical_salinity",
        gaps=True,
        comment="PSS-78; NaN where the water column has only density",
    ),
    Variable(
        "true_altitude",
        "m",
        "height of the centre of buoyancy above the sea floor",
        "height_above_sea_floor",
    ),
    Variable(
        "true_contact",
        "1",
        "contact with sea floor or obstacles",
        comment="1 where the vehicle has touched one since the sample before",
    ),
    Variable(
        "measured_roll",
        "degree",
        "roll by the attitude sensor",
        "platform_roll_starboard_down",
        comment="starboard down",
    ),
    Variable(
        "measured_pitch",
        "degree",
        "pitch by the attitude sensor",
        "platform_pitch_fore_up",
        comment="nose up",
    ),
    Variable(
        "measured_heading",
        "degree",
        "heading by the compass",
        "platform_orientation",
        comment="from true north, clockwise",
    ),
    Variable(
        "measured_roll_rate",
        "rad s-1",
        "roll rate by the gyroscope",
        comment="angular velocity about the forward body axis",
    ),
    Variable(
        "measured_pitch_rate",
        "rad s-1",
        "pitch rate by the gyroscope",
        comment="angular velocity about the starboard body axis",
    ),
    Variable(
        "measured_yaw_rate",
        "rad s-1",
        "yaw rate by the gyroscope",
        comment="angular velocity about the downward body axis",
    ),
    Variable("measured_specific_force_x", "m s-2", "forward specific force by the accelerometer"),
    Variable("measured_specific_force_y", "m s-2", "starboard specific force by the accelerometer"),
    Variable("measured_specific_force_z", "m s-2", "downward specific force by the accelerometer"),
    Variable(
        "measured_pressure",
        "dbar",
        "sea pressure by the transducer",
        "sea_water_pressure",
        comment="0 at the surface",
    ),
    Variable(
        "measured_depth", "m", "depth by the vehicle", "depth", comment="computed from its pressure"
    ),
    Variable(
        "measured_altitude",
        "m",
        "height above the sea floor by the altimeter",
        "height_above_sea_floor",
        gaps=True,
        comment="NaN without an echo",
    ),
    Variable("measured_shift", "m", "battery position by its encoder"),
    Variable("measured_rotation", "degree", "battery rotation by its encoder"),
    Variable("measured_pump", "cm3", "pumped volume by its encoder"),
    Variable(
        "measured_gps_north",
        "m",
        "GPS fix north of the start",
        gaps=True,
        comment="NaN without a fix",
    ),
    Variable(
        "measured_gps_east",
        "m",
        "GPS fix east of the start",
        gaps=True,
        comment="NaN without a fix",
    ),
    Variable(
        "measured_dvl_surge",
        "m s-1",
        "surge velocity by the Doppler log",
        gaps=True,
        comment="forward; NaN without lock",
    ),
    Variable(
        "measured_dvl_sway",
        "m s-1",
        "sway velocity by the Doppler log",
        gaps=True,
        comment="starboard; NaN without lock",
    ),
    Variable(
        "measured_dvl_heave",
        "m s-1",
        "heave velocity by the Doppler log",
        gaps=True,
        comment="down; NaN without lock",
    ),
    Variable(
        "measured_dvl_mode", "1", "lock of the Doppler log", comment="0 none, 1 bottom, 2 water"
    ),
    Variable(
        "measured_onboard_north",
        "m",
        "distance north of the start by the vehicle",
        comment="dead-reckoned on board",
    ),
    Variable(
        "measured_onboard_east",
        "m",
        "distance east of the start by the vehicle",
        comment="dead-reckoned on board",
    ),
    Variable(
        "measured_density",
        "kg m-3",
        "in-situ density by the CTD",
        "sea_water_density",
        gaps=True,
        comment="from conductivity, temperature and pressure",
    ),
    Variable(
        "measured_temperature",
        "degree_Celsius",
        "in-situ temperature by the CTD",
        "sea_water_temperature",
        gaps=True,
    ),
    Variable(
        "measured_salinity",
        "1",
        "practical salinity by the CTD",
        "sea_water_practical_salinity",
        gaps=True,
        comment="PSS-78",
    ),
    Variable(
        "measured_conductivity",
        "S m-1",
        "electrical conductivity by the CTD",
        "sea_water_electrical_conductivity",
        gaps=True,
    ),
    Variable("measured_fin", "degree", "rudder angle", comment="positive turns to starboard"),
    Variable(
        "measured_phase",
        "1",
        "phase of the dive",
        comment="0 surface, 1 descent, 2 climb, 3 inflection or level",
    ),
    Variable(
        "measured_gap",
        "1",
        "flag of interpolated samples",
        comment="1 where no original sample of attitude or depth is near",
    ),
    Variable(
        "measured_current_north",
        "m s-1",
        "northward current by the vehicle",
        "northward_sea_water_velocity",
        gaps=True,
        comment="what it reckons with; NaN before it has one",
    ),
    Variable(
        "measured_current_east",
        "m s-1",
        "eastward current by the vehicle",
        "eastward_sea_water_velocity",
        gaps=True,
        comment="what it reckons with; NaN before it has one",
    ),
    Variable(
        "measured_depth_time",
        "s",
        "time of the nearest original sample of depth",
        comment="since the start of the mission",
    ),
    Variable(
        "measured_attitude_time",
        "s",
        "time of the nearest original sample of attitude",
        comment="since the start of the mission",
    ),
    Variable(
        "measured_ctd_time",
        "s",
        "time of the nearest original sample of the CTD",
        comment="since the start of the mission",
    ),
    Variable("commanded_shift", "m", "commanded battery position"),
    Variable("commanded_rotation", "degree", "commanded battery rotation"),
    Variable("commanded_pump", "cm3", "commanded pumped volume"),
    Variable(
        "commanded_pitch",
        "degree",
        "pitch setpoint",
        gaps=True,
        comment="NaN where the segment has none",
    ),
    Variable(
        "commanded_heading",
        "degree",
        "heading setpoint",
        gaps=True,
        comment="NaN where the segment has none",
    ),
    Variable(
        "commanded_segment",
        "1",
        "index of the mission segment being flown",
        comment="-1 before the first",
    ),
    Variable(
        "commanded_waypoint_north",
        "m",
        "waypoint north of the start",
        gaps=True,
        comment="NaN without one",
    ),
    Variable(
        "commanded_waypoint_east",
        "m",
        "waypoint east of the start",
        gaps=True,
        comment="NaN without one",
    ),
)

LOGGED_ONLY = frozenset(
    {
        "true_speed",
        "measured_fin",
        "measured_phase",
        "measured_gap",
        "measured_current_north",
        "measured_current_east",
        "measured_depth_time",
        "measured_attitude_time",
        "measured_ctd_time",
        "commanded_waypoint_north",
        "commanded_waypoint_east",
    }
)
"""Variables that only stores of real logs hold; the twin does not simulate them."""

HYDROGRAPHY = frozenset(
    {
        "true_temperature",
        "true_salinity",
        "measured_density",
        "measured_temperature",
        "measured_salinity",
        "measured_conductivity",
    }
)
"""Variables of simulated missions in water whose temperature and salinity are known."""

WITH_FLOOR = ("true_altitude", "true_contact", "measured_altitude")
"""Variables of simulated missions that have a sea floor; contact also of those with obstacles."""
