"""Climb effort: a feature of two terms for `learn fit --features`."""

from twin.navigation.features import Feature, Term, register


def product(pump, rate):
    return pump * rate


register(
    Feature(
        name="climb_effort",
        group="controls",
        unit="cm3 m s-1",
        terms=(
            Term(channel="measured_pump", look="mean", seconds=20.0),
            Term(channel="measured_depth", look="slope", seconds=5.0),
        ),
        combine=product,
        c="return t[0] * t[1];",
    )
)
