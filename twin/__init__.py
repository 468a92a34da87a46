"""Twin of an underwater glider: MuJoCo physics, currents, control, sensors and the data schema."""

from twin.private import ensure_numba_cache

ensure_numba_cache()
