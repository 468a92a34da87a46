"""Controls: where a glider's parts are, how fast they move, and where they were told to go."""

from twin.navigation.features.base import Feature, Look, Shape, Term


def _of(
    name: str,
    group: str,
    channel: str,
    unit: str,
    shape: Shape = "plain",
    look: Look = "last",
    *,
    odd: bool = False,
) -> Feature:
    term = Term(channel=channel, shape=shape, look=look)
    return Feature(name=name, group=group, unit=unit, terms=(term,), odd=odd)


SHIFT = _of("shift", "controls", "measured_shift", "m")
SIN_ROTATION = _of("sin_rotation", "controls", "measured_rotation", "1", "sine", odd=True)
COS_ROTATION = _of("cos_rotation", "controls", "measured_rotation", "1", "cosine")
PUMP = _of("pump", "controls", "measured_pump", "cm3")
SHIFT_CHANGE = _of("shift_change", "control_rate", "measured_shift", "m s-1", look="slope")
ROTATION_CHANGE = _of(
    "rotation_change", "control_rate", "measured_rotation", "rad s-1", "angle", "slope", odd=True
)
PUMP_CHANGE = _of("pump_change", "control_rate", "measured_pump", "cm3 s-1", look="slope")
SHIFT_COMMAND = _of("shift_command", "commands", "commanded_shift", "m")
SIN_ROTATION_COMMAND = _of(
    "sin_rotation_command", "commands", "commanded_rotation", "1", "sine", odd=True
)
COS_ROTATION_COMMAND = _of("cos_rotation_command", "commands", "commanded_rotation", "1", "cosine")
PUMP_COMMAND = _of("pump_command", "commands", "commanded_pump", "cm3")
