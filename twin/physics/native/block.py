"""The block and the state through which Python talks to native code, as named structured types.

Everything that native code reads belongs to MuJoCo. A model carries its block at the end of
`mjModel.numeric_data`, in a `<numeric>` that compiling appends: first the tables (parts, hull law,
mission, current, density, sea floor), then the HEADER, which says where they are. So a model can
be copied, pickled, saved, loaded in another process and given to `mujoco.batch` like any other.

State that must follow a simulation sits in `mjData.userdata`: first the STATE, then the last log
rows in a ring. Units are SI, axes FRD and NED. All fields are float64.
"""

from __future__ import annotations

import numpy as np

from twin.mission.mission_file import GAINS, GUIDANCE_STATE
from twin.vehicle.parts.base import VALUES

NAME = "glider_twin_block"
MAGIC = 7.316e-217  # a value no vehicle parameter has
VERSION = 5.0
CONTROL_NONE, CONTROL_MISSION, CONTROL_SCHEDULE = 0.0, 1.0, 2.0
TABLE = np.dtype([("start", "f8"), ("size", "f8")])
"""A table inside the block: first number, counted from the block's, and how many numbers."""
PART = np.dtype(
    [
        ("kind", "f8"),  # code in the registry of parts
        ("low", "f8"),
        ("high", "f8"),  # travel
        ("lag", "f8"),  # [s]
        ("rate", "f8"),  # per second
        ("one_way", "f8"),  # 1: never rises again
        ("rest", "f8"),  # position at which it neither drives nor steers
        ("zero", "f8"),  # position when its encoder says 0, of parts without a joint
        ("gives_volume", "f8"),
        ("gives_mass", "f8"),
        ("gives_wrench", "f8"),  # 1: it has such a kernel
        ("place", "f8", (3,)),  # [m] FRD about the CB
        ("dof", "f8"),  # of the joint that it drives, -1: none
        ("servo_damping", "f8"),  # of its servo [N s/m or N m s/rad]
        ("values", "f8", (VALUES,)),  # as its kernels read them
    ]
)
HEADER = np.dtype(
    [
        ("words", "f8"),  # numbers of the whole block, this header included
        # what the model must be for native code to touch it
        ("nq", "f8"),
        ("nv", "f8"),
        ("nu", "f8"),
        ("na", "f8"),
        ("nbody", "f8"),
        ("nuserdata", "f8"),
        ("hull_body", "f8"),
        # the vehicle
        ("rigid_mass", "f8"),  # [kg] hull and everything it carries
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
        ("coupling", "f8"),  # 1: the added mass's own coupling acts, 0: it is in the law
        ("rotary_inertia", "f8", (3,)),  # roll, pitch, yaw with added mass [kg m2]
        ("law", "f8"),  # code in the registry of hull laws
        ("law_scaled", "f8"),  # 1: its coefficients hold the reference density
        ("law_values", TABLE),
        ("parts", TABLE),
        ("acting", "f8"),  # 1: some part does more than displace volume at the CB
        # water
        ("current", TABLE),
        ("density", TABLE),
        ("temperature", TABLE),  # in situ, likewise; empty: not known
        ("floor", TABLE),
        ("floor_body", "f8"),  # place of the floor's plane among the mocap bodies
        # control
        ("control", "f8"),  # CONTROL_NONE, CONTROL_MISSION or CONTROL_SCHEDULE
        ("control_period", "f8"),  # [s]
        ("gains", "f8", (GAINS,)),
        ("plan", TABLE),  # mission table or schedule
        ("plan_rows", "f8"),
        # log and integration
        ("log_period", "f8"),  # [s], 0: no log
        ("log_samples", "f8"),  # of the whole run
        ("log_ring", "f8"),  # rows that userdata holds
        ("centred", "f8"),  # 1: water at the time-centred velocity
        ("implicit", "f8"),  # 1: then the law's rotary damping is solved for, not extrapolated
        ("version", "f8"),
        ("magic", "f8"),
    ]
)
STATE = np.dtype(
    [
        ("ticks", "f8"),  # control ticks done
        ("logged", "f8"),  # log rows begun
        ("open", "f8"),  # 1 while the last log row awaits its acceleration
        ("failed", "f8"),  # 1 once the state left the finite numbers
        ("fail_time", "f8"),  # [s]
        ("current", "f8", (3,)),  # NED [m/s]
        ("density", "f8"),  # [kg/m3] at the CB
        ("immersion", "f8"),  # mean immersed fraction
        ("net_mass", "f8"),  # [kg] fully immersed
        ("hull_temperature", "f8"),  # [degC]
        ("hull_time", "f8"),  # [s] that it is for
        ("hull_known", "f8"),  # 1 once the two above hold something
        ("altitude", "f8"),  # [m] of the CB above the sea floor; inf without one
        ("contact", "f8"),  # 1: touched something since the last log row
        ("time", "f8"),  # [s] of the last time-centred evaluation
        ("twist", "f8", (6,)),  # qvel[0:6] then
        ("earlier", "f8", (6,)),  # qvel[0:6] one step before that
        ("known", "f8"),  # 1 once the three above hold something
        ("guidance", "f8", (GUIDANCE_STATE,)),
    ]
)
HEADER_WORDS = HEADER.itemsize // 8
STATE_WORDS = STATE.itemsize // 8
PART_WORDS = PART.itemsize // 8
RING = 256
"""Log rows that a simulation's `userdata` holds."""


def log_row(nq: int, nv: int, nu: int) -> np.dtype:
    """One row of the log of a model with these widths."""
    return np.dtype(
        [
            ("time", "f8"),  # [s]
            ("qpos", "f8", (nq,)),
            ("qvel", "f8", (nv,)),
            ("act", "f8", (nu,)),
            ("ctrl", "f8", (nu,)),  # as MuJoCo has them
            ("current", "f8", (3,)),
            ("density", "f8"),
            ("immersion", "f8"),
            ("net_mass", "f8"),
            ("contact", "f8"),  # 1: touched something since the row before
            ("pitch_setpoint", "f8"),
            ("heading_setpoint", "f8"),
            ("segment", "f8"),
            ("acceleration", "f8", (6,)),  # d(qvel)/dt over the step after the sample
        ]
    )
