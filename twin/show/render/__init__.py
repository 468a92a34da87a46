"""Renderer: pictures and videos of trajectories without a screen, and the viewer's window."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.show.render.canvas import OTHER_TRACKS as OTHER_TRACKS
    from twin.show.render.context import new_context as new_context
    from twin.show.render.context import require_screen as require_screen
    from twin.show.render.film import STILL_FORMATS as STILL_FORMATS
    from twin.show.render.film import VIDEO_FORMATS as VIDEO_FORMATS
    from twin.show.render.film import default_workers as default_workers
    from twin.show.render.film import save_still as save_still
    from twin.show.render.film import save_video as save_video
    from twin.show.render.film import still as still
    from twin.show.render.subject import Live as Live
    from twin.show.render.subject import RenderedFlight as RenderedFlight
    from twin.show.render.subject import Replay as Replay
    from twin.show.render.subject import Shot as Shot
    from twin.show.render.subject import Subject as Subject
    from twin.show.render.subject import read_subject as read_subject
    from twin.show.render.window import KEYS as KEYS
    from twin.show.render.window import Window as Window

__getattr__, __dir__ = attach(__name__, places(__name__))
