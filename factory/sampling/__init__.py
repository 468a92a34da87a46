"""Sampling: recipes of stores, random parameters of missions, and the flight of one mission."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.sampling.conditions import ballast_of as ballast_of
    from factory.sampling.conditions import believed_vehicle as believed_vehicle
    from factory.sampling.conditions import build_current as build_current
    from factory.sampling.conditions import build_density as build_density
    from factory.sampling.conditions import encoder_zeros as encoder_zeros
    from factory.sampling.conditions import origin as origin
    from factory.sampling.conditions import spread_vehicle as spread_vehicle
    from factory.sampling.distribution import Distribution as Distribution
    from factory.sampling.distribution import number as number
    from factory.sampling.draw import Parameters as Parameters
    from factory.sampling.draw import check_room as check_room
    from factory.sampling.draw import draw_values as draw_values
    from factory.sampling.fly import Impossible as Impossible
    from factory.sampling.fly import check_possible as check_possible
    from factory.sampling.mission_kinds import propelled as propelled
    from factory.sampling.parameters import Table as Table
    from factory.sampling.parameters import declared as declared
    from factory.sampling.parameters import override as override
    from factory.sampling.parameters import parameter_table as parameter_table
    from factory.sampling.presets import PRESETS as PRESETS
    from factory.sampling.presets import read_changes as read_changes
    from factory.sampling.presets import reference_set as reference_set
    from factory.sampling.recipe import Recipe as Recipe
    from factory.sampling.recipe import make_recipe as make_recipe

__getattr__, __dir__ = attach(__name__, places(__name__))
