"""Payload signals: oxygen, chlorophyll and other sensors that a vehicle carries beside its CTD."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from factory.importing.deployment_log import EMPTY, Channel
from factory.importing.tally import Tally, leave_out
from factory.importing.units import declared, is_declared, is_known
from twin.errors import InputError
from twin.records.schema import VARIABLES, Variable, declare

_ANY = (-1e9, 1e9)
"""Limits of a signal that is known by name only."""


@dataclasses.dataclass(frozen=True)
class PayloadSignal:
    """Payload signal, with its names in files, the preferred name first."""

    signal: str
    """Name in the store, `measured_...`."""
    sources: tuple[str, ...]
    units: str | None = None
    """Unit in the store; None: the file's unit, else 1."""
    long_name: str = ""
    limits: tuple[float, float] = _ANY
    standard_name: str | None = None
    by_user: bool = False
    """True if the unit is the user's, which overrides the file's."""


KNOWN = (
    PayloadSignal(
        "measured_oxygen",
        ("sci_oxy4_oxygen", "sci_oxy3835_oxygen", "sci_oxy3835_wphase_oxygen", "AROD_FT_DO",
         "LEGATO_CODA_DO", "eng_aa4330_O2", "DOXY"),
        "umol L-1", "dissolved oxygen", (-10.0, 1000.0),
        "mole_concentration_of_dissolved_molecular_oxygen_in_sea_water",
    ),
    PayloadSignal(
        "measured_chlorophyll",
        ("sci_flbbcd_chlor_units", "sci_flntu_chlor_units", "sci_flbb_chlor_units",
         "FLBBCD_CHL_SCALED", "FLNTU_CHL_SCALED", "CHLA"),
        "ug L-1", "chlorophyll by its fluorescence", (-10.0, 1000.0),
        "mass_concentration_of_chlorophyll_in_sea_water",
    ),
    PayloadSignal(
        "measured_dissolved_organic_matter",
        ("sci_flbbcd_cdom_units", "FLBBCD_CDOM_SCALED", "CDOM"),
        "1e-9", "coloured dissolved organic matter by its fluorescence, ppb", (-100.0, 10_000.0),
    ),
    PayloadSignal(
        "measured_backscatter",
        ("sci_flbbcd_bb_units", "sci_flbb_bb_units", "FLBBCD_BB_700_SCALED"),
        "m-1 sr-1", "volume scattering near 700 nm", (-1.0, 100.0),
    ),
    PayloadSignal(
        "measured_turbidity", ("sci_flntu_turb_units", "FLNTU_NTU_SCALED", "TURBIDITY"),
        "1", "turbidity, NTU", (-100.0, 10_000.0),
    ),
)  # fmt: skip

_MAPPING = re.compile(r"(?P<name>[a-z][a-z0-9_]*)=(?P<source>[^=\[\]]+)(\[(?P<units>[^\]]+)\])?")


def parse_payload(words: Sequence[str]) -> tuple[PayloadSignal, ...]:
    """Parse the user's mappings: `oxygen=sci_oxy4_oxygen` or `nitrate=NO3[umol L-1]`.

    Raises:
      InputError: another form, or a signal that every store has.
    """
    found = []
    known = {one.signal: one for one in KNOWN}
    for word in words:
        match = _MAPPING.fullmatch(word.strip())
        if match is None:
            raise InputError(
                f"payload {word!r}: write NAME=COLUMN or NAME=COLUMN[UNITS], such as "
                "oxygen=sci_oxy4_oxygen or nitrate=NO3[umol L-1]; NAME in small letters"
            )
        name, source, units = match["name"], (match["source"],), match["units"]
        signal = f"measured_{name}"
        if signal in _STORE_SIGNALS:
            raise InputError(
                f"payload {word!r}: {signal} is a signal of every store; choose another name"
            )
        base = known.get(signal)
        if base is not None and units in (None, base.units):
            found.append(dataclasses.replace(base, sources=source, by_user=units is not None))
        else:
            words_of = name.replace("_", " ")
            found.append(PayloadSignal(signal, source, units, words_of, by_user=True))
    return tuple(found)


_STORE_SIGNALS = frozenset(VARIABLES)
"""Signals of every store, which no payload may replace."""


def payload_names(payload: Iterable[PayloadSignal]) -> tuple[str, ...]:
    """Names of payload columns in files: the known names and those that the user maps."""
    return tuple(dict.fromkeys(name for one in (*payload, *KNOWN) for name in one.sources))


def _in_unit(
    channel: Channel, said: str, signal: PayloadSignal, name: str, tally: Tally
) -> Channel:
    """Convert a channel from its file's unit to the signal's; empty for another quantity.

    A unit given by the user stands. An unknown unit, such as one of a calibration, is taken for the
    signal's unit, and noted.
    """
    if signal.units is None or signal.by_user or not is_declared(said) or said == "1":
        return channel
    if not is_known(said):
        tally.add("note", name, len(channel), f"its unit {said!r} taken as {signal.units}")
        return channel
    values = declared(channel.values, said, signal.units, name, tally)
    return EMPTY if values is None else Channel(channel.time, values)


def payload_channels(
    found: Mapping[str, Channel],
    payload: Sequence[PayloadSignal],
    tally: Tally,
    *,
    units: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Channel]:
    """Payload signals of a log; if several names give one signal, the first with values.

    Args:
      found: finite samples by the file's own names.
      payload: the user's mappings, which take precedence over the known names.
      units: units that the file states, by name.

    Raises:
      InputError: a mapped signal was declared with another unit before.
    """
    channels: dict[str, Channel] = {}
    mapped = {one.signal for one in payload}
    for one in (*payload, *(k for k in KNOWN if k.signal not in mapped)):
        there = [name for name in one.sources if len(found.get(name, ()))]
        # vehicles write 0 for sensors that their software knows and that are not fitted
        idle = [name for name in there if not found[name].values.any()]
        leave_out(idle, "0 throughout: a sensor that the vehicle has not", tally)
        there = [name for name in there if name not in idle]
        if not there:
            continue
        source = there[0]
        leave_out(there[1:], f"{source} is taken as {one.signal}", tally)
        said = units.get(source, "")
        channel = _in_unit(found[source], said, one, source, tally)
        low, high = one.limits
        good = (channel.values >= low) & (channel.values <= high)
        tally.add("removed", source, ~good, f"outside {low:g} to {high:g}")
        if not good.any():
            continue
        entry = Variable(
            one.signal, one.units or said or "1", one.long_name or one.signal, one.standard_name,
            one.limits, True,
        )  # fmt: skip
        try:
            declare(entry)
        except InputError:
            if one.signal in mapped:
                raise
            why = f"a sensor of your own gives {one.signal} another meaning; map it by --payload"
            leave_out([source], why, tally)
            continue
        channels[one.signal] = Channel(channel.time[good], channel.values[good])
    return channels
