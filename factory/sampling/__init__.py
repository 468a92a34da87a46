"""Sampling: what decides the bytes of a store, and one mission flown from its parameters."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.sampling.drawn_plan import check_room as check_room
    from factory.sampling.parameters import override as override
    from factory.sampling.parameters import parameter_table as parameter_table
    from factory.sampling.presets import PRESETS as PRESETS
    from factory.sampling.presets import read_changes as read_changes
    from factory.sampling.presets import reference_set as reference_set
    from factory.sampling.recipe import Recipe as Recipe
    from factory.sampling.recipe import make_recipe as make_recipe

__getattr__, __dir__ = attach(__name__, places(__name__))
