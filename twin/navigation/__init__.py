"""Navigation: a vehicle's position, estimated on board under way or from its record later."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.navigation.current.modes import Ellipse as Ellipse
    from twin.navigation.current.modes import chi_squared as chi_squared
    from twin.navigation.current.modes import outline as outline
    from twin.navigation.settings import sources as sources

__getattr__, __dir__ = attach(__name__, places(__name__))
