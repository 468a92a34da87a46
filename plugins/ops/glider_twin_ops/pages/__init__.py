"""Pages of a vehicle at sea, each one file that needs no network."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_ops.pages.forecast_page import check_forecast_target as check_forecast_target
    from glider_twin_ops.pages.forecast_page import forecast_row as forecast_row
    from glider_twin_ops.pages.forecast_page import write_forecast as write_forecast
    from glider_twin_ops.pages.log_pages import write_health as write_health
    from glider_twin_ops.pages.log_pages import write_hindcast as write_hindcast
    from glider_twin_ops.pages.morning_page import summary as summary

__getattr__, __dir__ = attach(__name__, places(__name__))
