"""Generation: fly many missions into one store, in parallel and resumable."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.generation.executors import dask_executor as dask_executor
    from factory.generation.executors import local_pool as local_pool
    from factory.generation.generated_store import GeneratedStore as GeneratedStore
    from factory.generation.generated_store import StoredFlight as StoredFlight
    from factory.generation.generated_store import is_flight as is_flight
    from factory.generation.generated_store import open_exportable as open_exportable
    from factory.generation.generated_store import open_missions as open_missions
    from factory.generation.generation import Summary as Summary
    from factory.generation.generation import Watcher as Watcher
    from factory.generation.generation import generate as generate
    from factory.generation.job import unfinished as unfinished
    from factory.generation.parts import StorePart as StorePart
    from factory.generation.parts import finish as finish
    from factory.generation.parts import generate_part as generate_part
    from factory.generation.parts import hours_of as hours_of
    from factory.generation.parts import parse_part as parse_part
    from factory.generation.parts import slurm_part as slurm_part

__getattr__, __dir__ = attach(__name__, places(__name__))
