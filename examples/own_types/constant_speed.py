"""Constant speed: a velocity estimator, and a baseline of every evaluation."""

from twin.navigation.estimators import BodyVelocity, VelocityEstimator, register


@register
class ConstantSpeed(VelocityEstimator):
    kind = "constant_speed"
    summary = "0.35 m/s ahead wherever the vehicle is under water"
    channels = ("measured_depth",)

    def step(self, sample):
        return BodyVelocity(surge=0.35 * (sample["measured_depth"] > 1.0), sway=0.0)
