"""Block: structured types of the parameters and the state that Python and native code share.

MuJoCo owns the memory. A model carries its block at the end of `mjModel.numeric_data`, in a
`<numeric>` that compiling appends: first the tables (parts, hull law, mission, current, density,
sea floor), then the HEADER, which gives their places. So a model can be copied, pickled, saved,
loaded in another process and given to `mujoco.batch` like any other.

The state of a simulation lies in `mjData.userdata`: first the STATE, then a ring of the last log
rows. Units are SI, axes FRD and NED. All fields are float64.
"""

from __future__ import annotations

import numpy as np

from twin.mission.mission_file import GAINS, GUIDANCE_STATE
from twin.vehicle.parts.base import VALUES

NAME = "glider_twin_block"
MAGIC = 7.316e-217  # a value no vehicle parameter has
VERSION = 6.0
CONTROL_NONE, CONTROL_MISSION, CONTROL_SCHEDULE = 0.0, 1.0, 2.0
TABLE = np.dtype([("start", "f8"), ("size", "f8")])
"""Place of a table: index of its first number in the block, and count of its numbers."""
PART = np.dtype(
    [
        ("kind", "f8"),  # code of the type of part
        ("low", "f8"),
        ("high", "f8"),  # travel
        ("lag", "f8"),  # [s]
        ("rate", "f8"),  # per second
        ("one_way", "f8"),  # 1: the position never rises, like a dropped weight's
        ("rest", "f8"),  # position without drive or steering
        ("zero", "f8"),  # position when its encoder reads 0, for a part without joint
        ("gives_volume", "f8"),
        ("gives_mass", "f8"),
        ("gives_wrench", "f8"),  # 1: its type has a kernel of that name
        ("place", "f8", (3,)),  # [m] FRD about the CB
        ("dof", "f8"),  # index of the joint that it drives, -1: none
        ("servo_damping", "f8"),  # [N s/m or N m s/rad] of its servo
        ("values", "f8", (VALUES,)),  # parameters of its kernels
    ]
)
HEADER = np.dtype(
    [
        ("words", "f8"),  # numbers of the whole block, this header included
        # sizes that the model must have before native code touches it
        ("nq", "f8"),
        ("nv", "f8"),
        ("nu", "f8"),
        ("na", "f8"),
        ("nbody", "f8"),
        ("nuserdata", "f8"),
        ("hull_body", "f8"),
        # the vehicle
        ("rigid_mass", "f8"),  # [kg] hull and everything that it carries
        ("neutral_volume", "f8"),  # [m3]
        ("gravity", "f8"),  # [m/s2]
        ("reference_density", "f8"),  # [kg/m3]
        ("compressibility", "f8"),  # [1/Pa]
        ("thermal_expansion", "f8"),  # [1/K]
        ("thermal_lag", "f8"),  # [s]
        ("reference_temperature", "f8"),  # [degC]
        ("length", "f8"),  # [m]
        ("diameter", "f8"),  # [m]
        ("added_mass", "f8", (6, 6)),  # FRD about the CB
        ("coupling", "f8"),  # 1: Coriolis terms of M_A act, 0: the law has them
        ("rotary_inertia", "f8", (3,)),  # roll, pitch, yaw with added mass [kg m2]
        ("law", "f8"),  # code of the type of hull law
        ("law_scaled", "f8"),  # 1: its coefficients contain the reference density
        ("law_values", TABLE),
        ("parts", TABLE),
        ("acting", "f8"),  # 1: some part does more than displace volume at the CB
        # water
        ("current", TABLE),
        ("density", TABLE),
        ("temperature", TABLE),  # in situ, for hulls that expand; empty: unknown
        ("floor", TABLE),
        ("floor_body", "f8"),  # index of the floor's plane among the mocap bodies
        # control
        ("control", "f8"),  # CONTROL_NONE, CONTROL_MISSION or CONTROL_SCHEDULE
        ("control_period", "f8"),  # [s]
        ("gains", "f8", (GAINS,)),
        ("plan", TABLE),  # mission table or schedule
        ("plan_rows", "f8"),
        # log and integration
        ("log_period", "f8"),  # [s], 0: no log
        ("log_samples", "f8"),  # samples of the whole run
        ("log_ring", "f8"),  # rows that userdata holds
        ("centred", "f8"),  # 1: water at the time-centred velocity
        ("implicit", "f8"),  # 1: rotary damping is solved for, not extrapolated
        ("version", "f8"),
        ("magic", "f8"),
    ]
)
STATE = np.dtype(
    [
        ("ticks", "f8"),  # control ticks done
        ("logged", "f8"),  # log rows begun
        ("open", "f8"),  # 1 while the last log row awaits its acceleration
        ("failed", "f8"),  # 1 once the state is no longer finite
        ("fail_time", "f8"),  # [s]
        ("current", "f8", (3,)),  # NED [m/s]
        ("density", "f8"),  # [kg/m3] at the CB
        ("immersion", "f8"),  # mean immersed fraction
        ("net_mass", "f8"),  # [kg] fully immersed
        ("hull_temperature", "f8"),  # [degC]
        ("hull_time", "f8"),  # [s] time of hull_temperature
        ("hull_known", "f8"),  # 1 once the two fields above are set
        ("altitude", "f8"),  # [m] of the CB above the sea floor; inf without one
        ("contact", "f8"),  # 1: touched something since the last log row
        ("time", "f8"),  # [s] of the last time-centred evaluation
        ("twist", "f8", (6,)),  # qvel[0:6] at that time
        ("earlier", "f8", (6,)),  # qvel[0:6] one step before that
        ("known", "f8"),  # 1 once the three fields above are set
        ("user", "f8", (6,)),  # [N, N m] user's wrench on the hull, MuJoCo's world axes
        ("guidance", "f8", (GUIDANCE_STATE,)),
    ]
)
HEADER_WORDS = HEADER.itemsize // 8
STATE_WORDS = STATE.itemsize // 8
PART_WORDS = PART.itemsize // 8
RING = 256
"""Number of log rows that a simulation's `userdata` holds."""


def log_row(nq: int, nv: int, nu: int) -> np.dtype:
    """Type of a row of the log of a model with these widths."""
    return np.dtype(
        [
            ("time", "f8"),  # [s]
            ("qpos", "f8", (nq,)),
            ("qvel", "f8", (nv,)),
            ("act", "f8", (nu,)),
            ("ctrl", "f8", (nu,)),  # all four in MuJoCo's units and axes
            ("current", "f8", (3,)),
            ("density", "f8"),
            ("immersion", "f8"),
            ("net_mass", "f8"),
            ("contact", "f8"),  # 1: touched something since the previous row
            ("pitch_setpoint", "f8"),
            ("heading_setpoint", "f8"),
            ("segment", "f8"),
            ("acceleration", "f8", (6,)),  # d(qvel)/dt over the step after the sample
        ]
    )
