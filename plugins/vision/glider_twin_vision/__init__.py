"""Vision: a camera that sees markers on a vehicle and measures its velocity."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_vision.camera_sensor import Camera as Camera
    from glider_twin_vision.film import film as film
    from glider_twin_vision.lens import Lens as Lens
    from glider_twin_vision.markers import Board as Board
    from glider_twin_vision.observer import OBSERVERS as OBSERVERS
    from glider_twin_vision.scene import Scene as Scene
    from glider_twin_vision.scene import Water as Water
    from glider_twin_vision.smoother import Frames as Frames
    from glider_twin_vision.smoother import smooth as smooth

__getattr__, __dir__ = attach(__name__, places(__name__))
