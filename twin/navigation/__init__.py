"""Navigation: a vehicle's position, estimated on board under way or from its record later."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.navigation.current.modes import Ellipse as Ellipse
    from twin.navigation.current.modes import chi_squared as chi_squared
    from twin.navigation.current.modes import outline as outline
    from twin.navigation.propelled_surge import LiftBalance as LiftBalance
    from twin.navigation.propelled_surge import Propulsion as Propulsion
    from twin.navigation.propelled_surge import ThrustBalance as ThrustBalance
    from twin.navigation.settings import sources as sources
    from twin.navigation.standstill import largest_surge as largest_surge
    from twin.navigation.standstill import quiet_rate as quiet_rate
    from twin.navigation.standstill import standing as standing
    from twin.navigation.standstill import yaw_noise as yaw_noise

__getattr__, __dir__ = attach(__name__, places(__name__))
