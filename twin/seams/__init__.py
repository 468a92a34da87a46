"""Registry: the kinds of one seam by name: shipped, registered by the user, or from entry points.

Nothing is imported before it is asked for: shipped kinds are known by the place to import them
from, and an installed distribution adds its own under the seam's entry-point group:

    [project.entry-points."glider_twin.sensors"]
    turbidity = "my_package.turbidity:Turbidity"

For kinds in a single file, the environment variable `GLIDER_TWIN_PLUGINS` names Python files that
call a seam's `register`, separated as in PATH. Worker processes inherit the variable and so know
the same kinds. Kinds that a program registers itself are handed over with `registered` and `adopt`.
"""

from twin.seams.plugins import PLUGINS, imported, place_of, run_plugins
from twin.seams.registry import Registry, check_class, instance_of, missing_method, self_named

__all__ = [
    "PLUGINS",
    "Registry",
    "check_class",
    "imported",
    "instance_of",
    "missing_method",
    "place_of",
    "run_plugins",
    "self_named",
]
