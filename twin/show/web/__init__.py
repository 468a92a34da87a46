"""Web replay: a mission in three dimensions as one HTML file that any browser opens offline."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.show.web.page import ENDINGS as ENDINGS
    from twin.show.web.page import assemble as assemble
    from twin.show.web.page import page_text as page_text
    from twin.show.web.page import save_page as save_page
    from twin.show.web.server import PORT as PORT
    from twin.show.web.server import LiveMission as LiveMission
    from twin.show.web.server import PageServer as PageServer

__getattr__, __dir__ = attach(__name__, places(__name__))
