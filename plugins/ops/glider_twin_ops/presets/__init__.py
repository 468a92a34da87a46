"""Presets of simulated deployments with faults, stored as imported logs are."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_ops.presets.deployment import PERIODS as PERIODS
    from glider_twin_ops.presets.deployments import make_deployments as make_deployments

__getattr__, __dir__ = attach(__name__, places(__name__))
