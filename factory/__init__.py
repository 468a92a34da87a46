"""Data factory: randomised glider missions in bulk, written to one zarr store.

    import factory

    factory.generate("missions.zarr", preset="field", hours=10)
    store = factory.open("missions.zarr")

Every public name is imported when it is first used.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach

if TYPE_CHECKING:
    from factory.facade import generate as generate
    from factory.facade import import_logs as import_logs
    from factory.facade import parameters as parameters
    from factory.generation.generate import Summary as Summary
    from factory.generation.generated_store import GeneratedStore as GeneratedStore
    from factory.generation.generated_store import open_missions as open  # noqa: F401
    from factory.sampling.presets import PRESETS as PRESETS
    from twin.records.logged import LogStore as LogStore
    from twin.records.windows import Windows as Windows

_PLACES = {
    "PRESETS": "factory.sampling.presets:PRESETS",
    "LogStore": "twin.records.logged:LogStore",
    "GeneratedStore": "factory.generation.generated_store:GeneratedStore",
    "Windows": "twin.records.windows:Windows",
    "Summary": "factory.generation.generate:Summary",
    "generate": "factory.facade:generate",
    "import_logs": "factory.facade:import_logs",
    "open": "factory.generation.generated_store:open_missions",
    "parameters": "factory.facade:parameters",
}
"""Where each public name is."""

__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
