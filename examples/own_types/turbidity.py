"""Turbidity: a sensor for `--sensors field+turbidity`."""

import dataclasses

import numpy as np

from twin.records.schema import Variable
from twin.sensors import Sensor, register
from twin.sensors.base import NOWHERE


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class Turbidity(Sensor):
    """A turbidity meter in water that clears up with depth."""

    name = "turbidity"
    reads = ("true_depth",)
    writes = (
        Variable(
            "measured_turbidity", "NTU", "turbidity", "sea_water_turbidity", limits=(-5, 1000)
        ),
    )
    draws = {"turbidity_offset": "NTU"}

    offset: float = 0.2
    """[NTU] standard deviation of the zero error, drawn for each mission"""
    noise: float = 0.05
    """[NTU] white, standard deviation of a sample"""

    @classmethod
    def ideal(cls):
        return cls(offset=0.0, noise=0.0)

    def draw(self, rng):
        return {"turbidity_offset": float(rng.normal(0.0, self.offset))}

    def measure(self, signals, *, dt, drawn, rng, surroundings=NOWHERE):
        clear = 4.0 * np.exp(-np.asarray(signals["true_depth"]) / 20.0)
        noise = self.noise * rng.standard_normal(len(clear))
        return {"measured_turbidity": clear + drawn["turbidity_offset"] + noise}
