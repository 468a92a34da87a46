"""Data factory: randomised glider missions in bulk, written to one zarr store.

    import factory

    factory.generate("missions.zarr", preset="field", hours=10)
    store = factory.open("missions.zarr")

Each public name is imported on first use.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory import samples as samples
    from factory.facade import generate as generate
    from factory.facade import import_logs as import_logs
    from factory.facade import parameters as parameters
    from factory.generation.generated_store import GeneratedStore as GeneratedStore
    from factory.generation.generated_store import open_missions as open  # noqa: F401
    from factory.generation.generation import Summary as Summary
    from factory.sampling.presets import PRESETS as PRESETS
    from twin.records.logged import LogStore as LogStore
    from twin.records.windows import Windows as Windows

_PLACES = places(__name__)
__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
