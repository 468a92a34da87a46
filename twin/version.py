"""Versions of the distribution, of the physics and of the readers of logs."""

__version__ = "0.1.0"
IMPORT_VERSION = 2
"""Version of the readers of logs, counted up when the same files give other values.

1: also all stores without an import version; 2: declared units, clocks of samples and flags of
fixes are read, and doubtful rows are marked."""
PHYSICS_VERSION = 3
"""Version of the physics that all vehicles share. A hull law or type of part that has changed since
has a later `physics`; a vehicle has the latest of all its versions (`Vehicle.physics_version`).

It rises by 1 when the same recipe gives another trajectory. 1: the first stores. 2: accelerating
and sheared water exerts a force on the hull, in proportion to the water's density. 3: no sensor
uses later samples. 4, some vehicles only: propellers, and body-axes laws in reversed flow."""
