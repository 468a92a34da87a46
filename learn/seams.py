"""Seams: the kinds of one sort, a row each: by what name they are known and where they lie.

Here are those of networks, optimisers and figures of the report. No torch is imported before one
is looked up.
"""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

NETWORKS: Registry[Any] = Registry(
    "network",
    group="glider_twin.networks",
    folder="learn/networks",
    base="learn.Network",
    page="reference/networks.md#one-of-your-own",
    shipped={
        "ema": "learn.networks.fixed_memory:ExponentialAverages",
        "elman": "learn.networks.elman:Elman",
        "lstm": "learn.networks.gated:Lstm",
        "gru": "learn.networks.gated:Gru",
        "tcn": "learn.networks.tcn:CausalConvolutions",
        "mlp": "learn.networks.fixed_memory:Memoryless",
    },
    check="learn.networks.base:check_network",
    check_shipped=False,
)
"""Networks that can be trained."""

OPTIMISERS: Registry[Any] = Registry(
    "optimiser",
    group="glider_twin.optimisers",
    folder="learn/training",
    base="learn.MinibatchOptimiser",
    page="reference/networks.md#one-of-your-own",
    shipped={
        "soap": "learn.training.minibatch:SoapOptimiser",
        "adam": "learn.training.minibatch:AdamOptimiser",
        "scg": "learn.training.scg:ScgOptimiser",
    },
    check="learn.training.optimiser:check_optimiser",
    check_shipped=False,
)
"""Ways to train them."""

REPORT_FIGURES: Registry[Any] = Registry(
    "report figure",
    group="glider_twin.report_figures",
    folder="learn/report",
    base="learn.ReportFigure",
    page="reference/networks.md#one-of-your-own",
    shipped={
        "velocities": "learn.report.velocities:Velocities",
        "distribution": "learn.report.error_figures:ErrorDistribution",
        "doppler_track": "learn.report.track_figures:DopplerTrack",
        "doppler_track_3d": "learn.report.track_figures:DopplerTrack3d",
        "doppler_errors": "learn.report.error_figures:DopplerErrors",
        "dives": "learn.report.velocities:Dives",
        "track": "learn.report.track_figures:TrackFigure",
        "track_3d": "learn.report.track_figures:Track3d",
        "errors": "learn.report.error_figures:Errors",
        "uncertainty": "learn.report.velocities:UncertaintyFigure",
        "training_data": "learn.report.training_data:TrainingData",
        "learning": "learn.report.lines:Learning",
    },
    check="learn.report.contents:check_figure",
    check_shipped=False,
)
"""Figures of a report, in the order of the page."""
