"""Flight: motion by a steady balance of forces whose constants are estimated under way.

See `twin.navigation.flight_filter`.
"""

from twin.navigation.features.base import Feature, Term

FLIGHT_SURGE = Feature(
    name="flight_surge", group="flight", unit="m s-1", terms=(Term(channel="estimated_surge"),)
)
FLIGHT_SWAY = Feature(
    name="flight_sway",
    group="flight",
    unit="m s-1",
    terms=(Term(channel="estimated_sway"),),
    odd=True,
)
FLIGHT_ATTACK = Feature(
    name="flight_attack", group="flight", unit="rad", terms=(Term(channel="estimated_attack"),)
)
