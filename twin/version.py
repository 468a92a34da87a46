"""Versions: of the distribution, of the physics and of the readers of logs."""

__version__ = "0.1.0"
IMPORT_VERSION = 2
"""Version of the readers of logs, counted up when the same files give other values.

1: up to the stores that name none; 2: declared units, clocks of samples and flags of fixes are
read, and doubtful rows are marked."""
PHYSICS_VERSION = 3
"""Version of the physics that every vehicle shares; a hull law or a kind of part that flies
otherwise since has a later `physics`, and a vehicle has the latest (`Vehicle.physics_version`).

Counted up when the same recipe flies another way. 1: up to the first stores of this program; 2:
water that accelerates and shears acts on the hull, and scales with its density; 3: no sensor knows
what comes later; 4, of some vehicles: body-axes laws in reversed flow, and screws."""
