"""Figures of a report by name, in the order of the page; imported when they are looked up."""

from __future__ import annotations

from typing import Any

from twin.seams import Registry

_HERE = "learn.report"

REPORT_FIGURES: Registry[Any] = Registry(
    "report figure",
    group="glider_twin.report_figures",
    shipped={
        "velocities": f"{_HERE}.velocities:Velocities",
        "distribution": f"{_HERE}.error_figures:ErrorDistribution",
        "doppler_track": f"{_HERE}.tracks:DopplerTrack",
        "doppler_track_3d": f"{_HERE}.tracks:DopplerTrack3d",
        "doppler_errors": f"{_HERE}.error_figures:DopplerErrors",
        "dives": f"{_HERE}.velocities:Dives",
        "track": f"{_HERE}.tracks:TrackFigure",
        "track_3d": f"{_HERE}.tracks:Track3d",
        "errors": f"{_HERE}.error_figures:Errors",
        "uncertainty": f"{_HERE}.velocities:UncertaintyFigure",
        "training_data": f"{_HERE}.training_data:TrainingData",
        "learning": f"{_HERE}.lines:Learning",
    },
    check=f"{_HERE}.report_figure:check_figure",
    check_shipped=False,
)
"""Every figure, a subclass of `learn.report.report_figure.ReportFigure`."""
