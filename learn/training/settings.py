"""Settings of a training as they are given, in Python and on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from learn.seams import NETWORKS, OPTIMISERS
from twin.cli.options import Seconds

CHOICES: Mapping[str, Mapping[str, object] | tuple[str, ...]] = {
    "network": NETWORKS,
    "inputs": ("full", "glider"),
    "optimiser": OPTIMISERS,
    "division": ("missions", "samples"),
    "device": ("auto", "cpu", "cuda"),
    "labels": ("truth", "dvl"),
    "smoothing": ("gaussian", "causal", "none"),
}
"""Options of few words. They are text for the parser, which would list None among the words."""


def _words(option: str) -> Any:
    """Form in which the help shows an option of `CHOICES`."""
    return tyro.conf.arg(metavar="{" + ",".join(CHOICES[option]) + "}")


NETWORK, INPUTS, OPTIMISER, DIVISION, DEVICE, LABELS, SMOOTHING = map(_words, CHOICES)


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Settings of a training; one that is None is the resumed run's own, or the default."""

    network: Annotated[str | None, NETWORK] = None
    """kind of network [default: ema, the paper's is elman]"""
    hidden: int | None = None
    """units per hidden layer [default: 50]"""
    layers: int | None = None
    """hidden layers [default: 3]"""
    delays: int | None = None
    """elman: past outputs that a hidden layer is fed back [default: 5]"""
    memories: tuple[float, ...] | None = None
    """ema: seconds of its averages, rising [default: 2 8 30]"""
    inputs: Annotated[str | None, INPUTS] = None
    """full needs gyroscopes and accelerometers, glider is what every glider's log has
    [default: full]"""
    features: tuple[str, ...] = ()
    """features or groups instead of a set of --inputs, such as attitude depth_rate glide_speed"""
    without: tuple[str, ...] = ()
    """features, groups or sensors (imu, attitude, controls) that the vehicle lacks"""
    optimiser: Annotated[str | None, OPTIMISER] = None
    """soap or adam with a schedule, or scg, the paper's conjugate gradients [default: soap]"""
    seconds: Seconds | None = None
    """time in training of each network, such as 120 (seconds) or 10min, to which preparing
    and judging add (10 s of one member take some 36 s in all); two are trained side by side
    [default: 120]"""
    epochs: int | None = None
    """passes over the training missions instead of a time (scg: iterations); repeatable"""
    window: int | None = None
    """networks with trained memory: samples that a piece of a mission counts; longer ones teach a
    longer memory [default: 128]"""
    washin: int | None = None
    """samples before it in which the network finds its state [default: 48]"""
    seed: int | None = None
    """of initial weights and order; every network gets one of its own from it [default: 0]"""
    members: int | None = None
    """networks per velocity; with more than one their spread is an uncertainty [default: 2]"""
    division: Annotated[str | None, DIVISION] = None
    """missions: the store's split; samples: the paper's random 70/15/15, which leaks
    [default: missions]"""
    labels: Annotated[str | None, LABELS] = None
    """what is learned: the truth of a simulated store, or what its Doppler log measured, cleaned
    [default: truth]"""
    known_current: str | None = None
    """--labels dvl: what is taken off bottom track. none: it is unknown, only water track is
    learned from; store: the store's current; or NORTH,EAST in m/s, 0,0 in still water
    [default: none]"""
    smoothing: Annotated[str | None, SMOOTHING] = None
    """--labels dvl: after outliers are removed; causal looks back only [default: gaussian]"""
    period: float | None = None
    """seconds between samples, a multiple of the store's: simulated missions as slow as a log"""
    start: Path | None = None
    """run whose networks the training starts from, with their inputs, scales and period:
    simulation then real"""
    buffer: int | None = None
    """samples of the missions that are shuffled together [default: 1048576]"""
    device: Annotated[str | None, DEVICE] = None
    """auto takes a GPU when there is one [default: cpu]"""
    mirror: tyro.conf.Suppress[bool] = True
    """show every mission mirrored too, port for starboard"""
    held_out: tyro.conf.Suppress[tuple[int, ...]] = ()
    """rows of the store that are not trained on, to be judged by"""

    def given(self, *names: str, **renamed: str) -> dict[str, Any]:
        """Select, of some settings, those that are not None, by name or by another one."""
        wanted = {**renamed, **{name: name for name in names}}
        values = {name: getattr(self, own) for name, own in wanted.items()}
        return {name: value for name, value in values.items() if value is not None}
