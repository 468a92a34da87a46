"""Settings: the options of a training, in Python and on the command line."""

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
    "inputs": ("full", "glider", "thrusters"),
    "optimiser": OPTIMISERS,
    "division": ("missions", "samples"),
    "device": ("auto", "cpu", "cuda"),
    "labels": ("truth", "dvl", "camera"),
    "smoothing": ("gaussian", "causal", "none"),
}
"""Options with a few allowed words; a Literal type would list None among the words."""


def _words(option: str) -> Any:
    """Placeholder of an option of `CHOICES` in the help text."""
    return tyro.conf.arg(metavar="{" + ",".join(CHOICES[option]) + "}")


NETWORK, INPUTS, OPTIMISER, DIVISION, DEVICE, LABELS, SMOOTHING = map(_words, CHOICES)


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Settings of a training; None takes the resumed run's value, or the default."""

    network: Annotated[str | None, NETWORK] = None
    """type of network [default: ema, the paper's is elman]"""
    hidden: int | None = None
    """units per hidden layer [default: 50]"""
    layers: int | None = None
    """number of hidden layers [default: 3]"""
    delays: int | None = None
    """elman: number of past outputs that a hidden layer gets back as input [default: 5]"""
    memories: tuple[float, ...] | None = None
    """ema: time constants of the averages in seconds, rising [default: 2 8 30]"""
    inputs: Annotated[str | None, INPUTS] = None
    """set of inputs: full needs gyroscopes and accelerometers, glider only channels that every
    glider's log has; thrusters is full with thrusters' commands [default: full]"""
    features: tuple[str, ...] = ()
    """features or groups instead of --inputs, such as attitude depth_rate glide_speed"""
    without: tuple[str, ...] = ()
    """features, groups or sensors (imu, attitude, controls) that the vehicle lacks"""
    optimiser: Annotated[str | None, OPTIMISER] = None
    """soap or adam with a schedule, or scg, the paper's conjugate gradients [default: soap]"""
    seconds: Seconds | None = None
    """training time of each network, such as 120 (seconds) or 10min; preparation and evaluation
    come on top (10 s of one member take about 36 s in all); two are trained side by side
    [default: 120]"""
    epochs: int | None = None
    """passes over the training missions instead of a time (scg: iterations); repeatable"""
    window: int | None = None
    """networks with trained memory: counted samples of a training window; longer ones teach a
    longer memory [default: 128]"""
    washin: int | None = None
    """samples before each window in which the network finds its state [default: 48]"""
    seed: int | None = None
    """seed of initial weights and order; every network's own seed derives from it [default: 0]"""
    members: int | None = None
    """networks per velocity; the standard deviation of several measures the error [default: 2]"""
    division: Annotated[str | None, DIVISION] = None
    """missions: the store's split; samples: the paper's random 70/15/15, which leaks
    [default: missions]"""
    labels: Annotated[str | None, LABELS] = None
    """velocities to learn: truth, dvl for the cleaned velocities of a Doppler log, or camera for
    those of markers (docs/howto/camera.md) [default: truth]"""
    known_current: str | None = None
    """--labels dvl or camera: current to subtract from velocities over ground. none: unknown, only
    water track gives labels; store: the store's current; or NORTH,EAST in m/s, 0,0 in still water
    [default: none]"""
    smoothing: Annotated[str | None, SMOOTHING] = None
    """--labels dvl: smoothing after outlier removal; causal looks back only [default: gaussian]"""
    period: float | None = None
    """seconds between samples, a multiple of the store's, for example a real log's period"""
    start: Path | None = None
    """run to start from, with its weights, inputs, normalisation and period, for example a run on
    simulated missions before training on logs"""
    buffer: int | None = None
    """samples of the missions that are shuffled together [default: 1048576]"""
    device: Annotated[str | None, DEVICE] = None
    """device of the training; auto takes a GPU if there is one [default: cpu]"""
    mirror: tyro.conf.Suppress[bool] = True
    """train on the mirror image of every mission too, port for starboard"""
    held_out: tyro.conf.Suppress[tuple[int, ...]] = ()
    """rows of the store that are not trained on, for evaluation"""

    def given(self, *names: str, **renamed: str) -> dict[str, Any]:
        """Settings among these names that are not None; `renamed` maps new names to settings."""
        wanted = {**renamed, **{name: name for name in names}}
        values = {name: getattr(self, own) for name, own in wanted.items()}
        return {name: value for name, value in values.items() if value is not None}
