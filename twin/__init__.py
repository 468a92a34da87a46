"""Twin of an underwater glider: MuJoCo physics, currents, control, sensors and the data schema."""

from twin.compiled.private import ensure_numba_cache

ensure_numba_cache()
