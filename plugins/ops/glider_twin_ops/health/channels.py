"""Channels: what one dive says of a vehicle's health, each a number that a sound vehicle repeats.

Channels are made so that what a pilot changes leaves them where they are: depth rates are beside a
flight model's with the logged pitch, pump and density, the battery's place beside what the logged
pitch needs, the pump's work beside that against the sea. `dive_channels` makes them of a log.
"""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True, kw_only=True)
class Channel:
    """One number of a dive."""

    name: str
    unit: str
    says: str
    """what it is, as a person reads it"""
    noise: float
    """Standard deviation from dive to dive of a sound vehicle, before its own dives say"""
    walk: float
    """Standard deviation of its change from dive to dive: seasons, water, wear that is no fault"""
    flown: bool = True
    """False: it depends on the sea and on noise, and flights of the twin do not tell it"""
    instead: str = ""
    """Channel that is judged in its stead in dives that tell it: what it shows, without the sea"""


CHANNELS: tuple[Channel, ...] = (
    Channel(name="rate_dive", unit="1", noise=0.02, walk=0.004,
            says="1 less the flight model's depth rate in dives over the log's"),
    Channel(name="rate_climb", unit="1", noise=0.015, walk=0.004,
            says="1 less the flight model's depth rate in climbs over the log's"),
    Channel(name="trim_dive", unit="mm", noise=0.4, walk=0.08,
            says="battery's place in dives, less what the pitch needs"),
    Channel(name="trim_climb", unit="mm", noise=0.4, walk=0.08,
            says="battery's place in climbs, less what the pitch needs"),
    Channel(name="roll_dive", unit="degree", noise=0.2, walk=0.05,
            says="roll in dives, less what a turning battery gives"),
    Channel(name="roll_climb", unit="degree", noise=0.2, walk=0.05,
            says="roll in climbs, less what a turning battery gives"),
    Channel(name="turn_dive", unit="degree", noise=0.4, walk=0.1,
            says="place of what turns it on a straight heading in dives"),
    Channel(name="turn_climb", unit="degree", noise=0.4, walk=0.1,
            says="place of what turns it on a straight heading in climbs"),
    Channel(name="turn_moves", unit="1", noise=0.4, walk=0.05, flown=False,
            says="logarithm of the way that what turns it makes in an hour"),
    Channel(name="heading_error", unit="1", noise=0.3, walk=0.06, flown=False,
            says="logarithm of the heading's median error"),
    Channel(name="pump_rate", unit="1", noise=0.02, walk=0.005,
            says="logarithm of the volume that is pumped in a second"),
    Channel(name="pump_work", unit="1", noise=0.02, walk=0.005,
            says="logarithm of the pump's energy over its work against the sea"),
    Channel(name="hotel", unit="W", noise=0.02, walk=0.005,
            says="power while no pump runs"),
    Channel(name="resistance", unit="1", noise=0.03, walk=0.005,
            says="logarithm of the voltage's drop over the current"),
    Channel(name="air", unit="1", noise=0.001, walk=0.0002,
            says="logarithm of the hull's pressure over its temperature"),
    Channel(name="surface_depth", unit="m", noise=0.08, walk=0.01,
            says="depth that it shows at the surface"),
    Channel(name="echoes", unit="1", noise=0.15, walk=0.02, flown=False,
            says="echoes of the floor over those that earlier dives had at its heights"),
    Channel(name="temperature_lag", unit="s", noise=3.0, walk=0.4,
            says="time by which the thermistor is late, by dives and climbs", instead="cell_lag"),
    Channel(name="cell_lag", unit="s", noise=1.0, walk=0.1,
            says="time by which the conductivity is later than the temperature"),
    Channel(name="lock", unit="1", noise=0.1, walk=0.02,
            says="part of the samples in which the Doppler log has lock"),
    Channel(name="current_north", unit="m s-1", noise=0.012, walk=0.006, flown=False,
            says="depth-averaged current to the north, by the compass' heading"),
    Channel(name="current_east", unit="m s-1", noise=0.012, walk=0.006, flown=False,
            says="depth-averaged current to the east, by the compass' heading"),
)  # fmt: skip
"""Every channel; noise and walk are of the size that sound simulated deployments of a Slocum have
(preset `faulty`), larger where they are hardly there; for `surface_depth` of that of four vehicles;
and for `cell_lag` of that of real ones: 1 s is the median of seven deployments at full rate. A
deployment's own dives change them"""
NAMES = tuple(channel.name for channel in CHANNELS)
PLACE = {name: k for k, name in enumerate(NAMES)}
FLOWN = np.array([channel.flown for channel in CHANNELS])
