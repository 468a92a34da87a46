"""Figures of a report by name, in the order of the page; imported when they are looked up."""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

_HERE = "learn.report.figures"

REPORT_FIGURES: Registry[Any] = Registry(
    "report figure",
    group="glider_twin.report_figures",
    shipped={
        "velocities": f"{_HERE}.velocities:Velocities",
        "distribution": f"{_HERE}.distribution:Distribution",
        "doppler_track": f"{_HERE}.doppler_track:DopplerTrack",
        "doppler_track_3d": f"{_HERE}.doppler_track_3d:DopplerTrack3d",
        "doppler_errors": f"{_HERE}.doppler_errors:DopplerErrors",
        "dives": f"{_HERE}.dives:Dives",
        "track": f"{_HERE}.track:Track",
        "track_3d": f"{_HERE}.track_3d:Track3d",
        "errors": f"{_HERE}.errors:Errors",
        "uncertainty": f"{_HERE}.uncertainty:Uncertainty",
        "training_data": f"{_HERE}.training_data:TrainingData",
        "learning": f"{_HERE}.learning:Learning",
    },
    check=f"{_HERE}.base:check_figure",
    check_shipped=False,
)
"""Every figure, a subclass of `learn.report.figures.base.ReportFigure`; its name is its file's."""
