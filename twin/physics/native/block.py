"""The parameter block and the state block through which Python talks to native code.

Parameters sit at the end of `mjModel.numeric_data`, in a `<numeric>` that loading appends; so
they belong to the model, and `mujoco.batch` can give each simulation its own. State that must
follow a simulation (guidance, logging, the water at the vehicle) sits in `mjData.userdata`, so
saving, copying and resetting MuJoCo states carries it along. Units are SI, axes FRD and NED.
"""

from __future__ import annotations

NAME = "glider_twin_block"
MAGIC = 7.316e-217  # a value no vehicle parameter has
VERSION = 1.0

# --- parameters -------------------------------------------------------------------------------
P_MAGIC, P_VERSION = 0, 1
P_HYDRODYNAMICS = 2  # COEFFICIENTS or ELLIPSOID
P_HULL_BODY = 3  # body id
P_RIGID_MASS = 4  # [kg] hull and everything it carries
P_NEUTRAL_VOLUME = 5  # [m3]
P_GRAVITY = 6  # [m/s2]
P_REFERENCE_DENSITY = 7  # [kg/m3]
P_COMPRESSIBILITY = 8  # [1/Pa]
P_LENGTH, P_DIAMETER = 9, 10  # [m]
P_DRAG, P_LIFT, P_SIDE, P_ROLL, P_PITCH, P_YAW = 11, 13, 15, 16, 18, 21
P_LINEAR_ANGLE, P_BLEND_ANGLE, P_MIN_SPEED = 23, 24, 25
P_ADDED_MASS = 26  # 36 values, row major, FRD about the CB
P_LAG, P_RATE = 62, 65  # 3 each
P_CONTROL = 68  # CONTROL_NONE, CONTROL_MISSION or CONTROL_SCHEDULE
P_CONTROL_PERIOD = 69  # [s]
P_GAINS = 70  # 7 values, as twin.mission.guidance expects
P_TABLE, P_TABLE_ROWS = 78, 79  # address and rows of the mission table or schedule
P_CURRENT, P_CURRENT_SIZE = 80, 81  # address and length of the compiled current
P_DENSITY, P_DENSITY_SIZE = 82, 83  # address and length of the compiled density profile
P_LOG, P_LOG_ROWS, P_LOG_PERIOD = 84, 85, 86  # address and capacity; [s], 0 = no log
P_FLUID, P_FLUID_COUNT = 87, 88  # address and number of ellipsoid fluid geoms
P_VISCOSITY = 89  # [Pa s], ellipsoid model only
P_ACTUATOR_MIN, P_ACTUATOR_MAX = 90, 93  # 3 each
P_CENTRED = 96  # 1: water at the time-centred velocity, see plant.remember_velocity
P_ROTARY_INERTIA = 97  # 3: roll, pitch, yaw inertia with added mass [kg m2]
PARAMETERS = 100

COEFFICIENTS, ELLIPSOID = 0.0, 1.0
CONTROL_NONE, CONTROL_MISSION, CONTROL_SCHEDULE = 0.0, 1.0, 2.0

# --- state ------------------------------------------------------------------------------------
U_TICKS = 0  # control ticks done
U_LOGGED = 1  # log rows begun
U_OPEN = 2  # 1 while the last log row awaits its acceleration
U_FAILED = 3  # 1 once the state left the finite numbers
U_FAIL_TIME = 4  # [s]
U_CURRENT = 5  # NED [m/s], 3 values
U_CURRENT_RATE = 8  # along the path, NED [m/s2], 3 values
U_DENSITY = 11  # [kg/m3] at the CB
U_IMMERSION = 12  # mean immersed fraction
U_NET_MASS = 13  # [kg] fully immersed
U_COMMAND = 14  # 3 values
U_TIME = 17  # [s] of the last evaluation with P_CENTRED
U_TWIST = 18  # qvel[0:6] then
U_EARLIER = 24  # qvel[0:6] one step before that
U_KNOWN = 30  # 1 once the three above hold something
U_GUIDANCE = 31  # twin.mission.guidance state follows

# --- one log row ------------------------------------------------------------------------------
R_TIME = 0
R_QPOS, R_QVEL, R_ACT, R_CTRL = 1, 10, 18, 21  # 9, 8, 3, 3 values as MuJoCo has them
R_CURRENT, R_DENSITY, R_IMMERSION, R_NET_MASS = 24, 27, 28, 29
R_PITCH_SETPOINT, R_HEADING_SETPOINT, R_SEGMENT = 30, 31, 32
R_ACCELERATION = 33  # 6 values: d(qvel)/dt over the step after the sample
ROW = 39

FLUID_ROW = 27
"""Per fluid geom, hull axes: position 3, rotation 9, semi-axes 3, MuJoCo's 12 coefficients."""
