"""Integration: the integrators, steps and sample periods that a run can have."""

from __future__ import annotations

import mujoco

from twin.errors import InputError
from twin.physics.obstacles import has_contacts

MOST_SAMPLES = 4_000_000
"""Samples of one run: about 1.3 GB of log, 23 days at 2 Hz"""
IMPLICIT_STEP = 0.02
"""[s] longest step at which implicit and implicitfast carry the stiff servos"""
_EXPLICIT = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)


def check_integration(model: mujoco.MjModel, period: float, samples: int, duration: float) -> None:
    """Refuse what cannot be flown: unsuitable integrators, uneven samples, too much memory.

    Args:
      model: with the integrator and the step of the run.
      period: [s] between samples.
      samples: of the whole run of `duration` [s].

    Raises:
      InputError: what is in the way, and what to take instead.
    """
    step, integrator = model.opt.timestep, model.opt.integrator
    if integrator in _EXPLICIT:
        raise InputError(
            "the battery's lead screws are too stiff for integrator euler or rk4 at any useful "
            "step; use discrete (or implicitfast up to a step of "
            f"{IMPLICIT_STEP:g} s)"
        )
    if integrator != mujoco.mjtIntegrator.mjINT_DISCRETE and step > IMPLICIT_STEP:
        raise InputError(
            f"timestep {step:g} s is too long for the stiff servos under this integrator; use "
            f"at most {IMPLICIT_STEP:g} s, or integrator discrete"
        )
    if integrator != mujoco.mjtIntegrator.mjINT_DISCRETE and has_contacts(model):
        raise InputError(
            "a sea floor or an obstacle needs integrator discrete: the implicit ones find the "
            "force of a contact without the battery's stiff servos, which throws the battery "
            "away at the first touch"
        )
    steps = period / step
    if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
        nearest = max(1, round(steps)) * step
        raise InputError(
            f"sample period {period:g} s is not a whole number of steps of {step:g} s; the "
            f"nearest is {nearest:g} s"
        )
    if samples < 2:
        raise InputError(
            f"a run of {duration:g} s holds fewer than two samples at a sample period of "
            f"{period:g} s; shorten the period"
        )
    if samples > MOST_SAMPLES:
        raise InputError(
            f"a run of {duration:g} s at a sample period of {period:g} s makes "
            f"{samples:,} samples, more than {MOST_SAMPLES:,}; shorten the mission or "
            "lengthen the period"
        )
