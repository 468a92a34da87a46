"""Data: missions of a store as the sequences that networks learn from."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from learn.data.dataset import Selection as Selection

__getattr__, __dir__ = attach(__name__, places(__name__))
