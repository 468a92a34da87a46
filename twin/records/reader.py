"""Reader: open a store of missions, simulated or logged, and check what xarray does not.

xarray silently numbers samples if the time is missing, and reads an array with missing files as
NaN. Every error here names the store and, if it concerns one, the array and the mission.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from twin.bounded import parse_json
from twin.errors import InputError, StoreError, unknown_name
from twin.records.attributes import (
    CONVENTIONS,
    HISTORY,
    N_SAMPLES,
    READER_VERSION,
    SAMPLE_PERIOD,
    SCENARIO,
    SCHEMA,
    SETTINGS,
    SOURCE_FORMAT,
    SPLIT,
    SPLITS,
    VEHICLE_MJCF,
    is_logged,
    is_missions,
)
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.schema.limits import recorded_limits
from twin.records.storage.store_path import StorePath, store_path
from twin.records.store import (
    check_arrays,
    check_chunks,
    check_filled,
    check_mission,
    gone_arrays,
    open_store,
    read_array,
)
from twin.records.trajectory import sample_times
from twin.vehicle.consumption import Consumption, needed_signals
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.version import IMPORT_VERSION

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal["simulated", "logged"]

LEAST_SAMPLES = 2
"""Minimum number of samples in a mission, because a rate of change needs two"""
READ_ALONG = 4 * 7200
"""Largest number of unwanted samples that are decoded between two wanted missions. Decoding more
samples costs more than another request for a slice."""
SPACING = 1e-3
"""[1] Tolerance of time steps relative to the period: rounding of float32 after a day"""
LOGGED_VEHICLES = {"slocum": "slocum-200", "seaglider": "seaglider", "seaexplorer": "seaexplorer"}
"""Shipped vehicle for each format of log, for stores without the vehicle's own file"""
OTHER_LOGGED_VEHICLE = "slocum-200"
"""Shipped vehicle for logs of all other formats"""
SIMULATED_VEHICLE = "glider"
"""Shipped vehicle for simulated stores without a vehicle's file"""


class MissionStore:
    """Complete store of missions, simulated or logged; a context manager.

    Raises:
      StoreError: missing, damaged, of a newer schema version, or of another schema.
    """

    def __init__(self, path: str | StorePath):
        self.path = store_path(path)
        self.dataset: xr.Dataset = open_store(self.path, dask=False)
        self._flags: dict[str, dict[int, str]] = {}
        self._whole: set[str] = set()
        """Names of arrays that are known to have all their files"""
        if not is_missions(self.attributes):
            self.close()
            found = self.attributes.get(SCHEMA)
            says = "no" if found is None else "the"
            says += f" attribute {SCHEMA}" + ("" if found is None else f" {found!r}")
            raise StoreError(
                f"store {path} has {says}, expected is {CONVENTIONS[SCHEMA]!r}: "
                "`factory generate`, `factory import` and `twin simulate --out` write such stores"
            )
        made = self.attributes.get(READER_VERSION, 1)
        if self.logged and made != IMPORT_VERSION:
            warnings.warn(
                f"{self.path} was imported by version {made} of the readers, and this is version "
                f"{IMPORT_VERSION}: units, clocks and fixes may have been taken otherwise; import "
                "its logs again",
                stacklevel=1,  # always this line, so that a process warns once
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        return int(self.dataset.sizes.get(MISSION, 0))

    def __contains__(self, name: object) -> bool:
        """Return whether the store has an array called `name`."""
        return name in self.dataset

    def _repr_html_(self) -> str:
        """Table and plot of the first mission's depth over time, for notebooks."""
        from twin.notebook import card, line

        rows = {
            "missions": len(self),
            "kind": self.kind,
            "hours": f"{sum(self.samples) * self.period / 3600.0:.4g}",
            "period": f"{self.period:g} s",
            "signals": len(self.signals()),
        }
        picture = ""
        for depth in [n for n in ("true_depth", "measured_depth") if n in self and len(self)][:1]:
            first = self.row(depth, 0)[: int(self.samples[0])].tolist()
            time = [k * self.period for k in range(len(first))]
            picture = line(time, first, "depth of mission 0 [m]", down=True)
        return card(str(self.path), rows, picture)

    def close(self) -> None:
        """Close the files."""
        self.dataset.close()

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the store."""
        return self.dataset.attrs

    @property
    def kind(self) -> Kind:
        """Origin of the missions: "simulated" or "logged"."""
        return "logged" if is_logged(self.attributes) else "simulated"

    @property
    def logged(self) -> bool:
        """True if the missions are logged dives."""
        return self.kind == "logged"

    @property
    def history(self) -> str:
        """Attribute `history`: time and command that made the store; empty if missing."""
        return str(self.attributes.get(HISTORY, ""))

    @property
    def says_vehicle(self) -> bool:
        """True if the store contains the description of the vehicle that flew the missions."""
        return SCENARIO in self.attributes or VEHICLE_MJCF in self.attributes

    @functools.cached_property
    def vehicle(self) -> Vehicle:
        """The vehicle that flew the missions.

        It is built from the store's MJCF text and the changes in the store's scenario. A store
        without MJCF text gives a shipped vehicle of the same type.

        Raises:
          StoreError, VehicleError: the description is damaged.
        """
        if self.logged and VEHICLE_MJCF not in self.attributes:
            kind = str(self.attributes[SOURCE_FORMAT])
            return load_vehicle(LOGGED_VEHICLES.get(kind, OTHER_LOGGED_VEHICLE))
        if SCENARIO in self.attributes:
            said = self.json(SCENARIO)["vehicle"]
            vehicle = parse_vehicle(said["mjcf"], Path(f"{said['name']}.xml"))
            return vehicle.with_changes(said["changes"])
        if VEHICLE_MJCF in self.attributes:
            settings = self.json(SETTINGS) if SETTINGS in self.attributes else {}
            name = settings.get("vehicle", self.path.stem)
            return parse_vehicle(str(self.attributes[VEHICLE_MJCF]), Path(f"{name}.xml"))
        return load_vehicle(SIMULATED_VEHICLE)

    def json(self, attribute: str) -> Any:
        """Parse an attribute that holds JSON.

        Raises:
          StoreError: the attribute is missing or damaged.
        """
        try:
            return parse_json(self.attributes[attribute], attribute)
        except (KeyError, InputError) as error:
            raise StoreError(
                f"store {self.path}: its attribute {attribute!r} cannot be read "
                f"({type(error).__name__}: {error})"
            ) from error

    @property
    def declared_period(self) -> float | None:
        """[s] Time between samples in the store's attributes; None if missing."""
        if SAMPLE_PERIOD in self.attributes:
            return float(self.attributes[SAMPLE_PERIOD])
        if SETTINGS in self.attributes:
            return float(self.json(SETTINGS)[SAMPLE_PERIOD])
        return None

    @functools.cached_property
    def period(self) -> float:
        """[s] Time between samples.

        Raises:
          StoreError: no coordinate `time`, fewer than two samples, or unequal steps.
        """
        if TIME not in self.dataset.coords:
            raise StoreError(
                f"store {self.path} has no coordinate {TIME!r}, so that the time between samples "
                "is not known; make it again"
            )
        time = self.array(TIME).astype(float)
        if len(time) < LEAST_SAMPLES:
            raise StoreError(
                f"store {self.path} has {len(time)} sample per mission, which needs "
                f"{LEAST_SAMPLES}; make it with longer missions"
            )
        steps = np.diff(time)
        period = float(np.median(steps))
        if not (period > 0.0 and np.allclose(steps, period, rtol=SPACING, atol=0.0)):
            raise StoreError(
                f"store {self.path} is not equally spaced in {TIME!r}; resample it first"
            )
        return period

    @functools.cached_property
    def samples(self) -> NDArray[np.int64]:
        """Number of samples of each mission, (mission,); later samples are padding.

        Raises:
          StoreError: the store lacks the array.
        """
        if N_SAMPLES not in self:
            raise StoreError(f"store {self.path} has no array {N_SAMPLES!r}; make it again")
        return np.nan_to_num(self.array(N_SAMPLES).astype(float), nan=0.0).astype(np.int64)

    def check_samples(self, missions: Sequence[int] | NDArray[np.intp], least: int = 1) -> None:
        """Raise StoreError if a mission has too few samples, or more samples than the arrays."""
        longest = self.dataset.sizes[TIME]
        for mission in missions:
            samples = self.samples[mission]
            if not least <= samples <= longest:
                raise StoreError(
                    f"store {self.path} is damaged: {N_SAMPLES} of mission {mission} is {samples}; "
                    f"its arrays allow {least} to {longest}; make the store again"
                )

    @functools.cached_property
    def splits(self) -> list[str]:
        """Name of each mission's split, from CF flags (numbers with `flag_meanings`) or texts.

        Raises:
          StoreError: the store has no splits, or names an unknown split.
        """
        if SPLIT not in self:
            raise StoreError(
                f"store {self.path} does not say which missions are for training (no array "
                f"{SPLIT!r}); use --split all, or a store made by `factory generate`"
            )
        values = self.array(SPLIT)
        if values.dtype.kind in "iuf":
            table = self.flags(SPLIT)
            words = [table.get(int(value), str(value)) for value in values]
        else:
            words = [v.decode() if isinstance(v, bytes) else str(v) for v in values]
        for word in sorted(set(words) - set(SPLITS)):
            raise StoreError(f"store {self.path}: {unknown_name('split', word, SPLITS)}")
        return words

    def flags(self, name: str) -> dict[int, str]:
        """Return the meaning of each integer of an array of CF flags; empty for other arrays."""
        if name not in self._flags:
            attributes = self.dataset.variables[name].attrs
            meanings = str(attributes.get("flag_meanings", "")).split()
            values = np.atleast_1d(attributes.get("flag_values", np.arange(len(meanings))))
            if len(values) != len(meanings):
                raise StoreError(
                    f"store {self.path}: {name!r} has {len(values)} flag_values and "
                    f"{len(meanings)} flag_meanings; make the store again"
                )
            self._flags[name] = dict(zip(map(int, values), meanings, strict=True))
        return self._flags[name]

    def array(self, name: str) -> NDArray[Any]:
        """Read a whole array.

        Raises:
          StoreError: the store lacks the array, or the array is damaged.
        """
        if name not in self.dataset.variables:
            raise StoreError(f"store {self.path} lacks the array {name!r}")
        self._check_whole(name)
        return read_array(self.dataset, name, self.path)

    def energy(
        self, mission: int, consumption: Consumption | None = None
    ) -> dict[str, NDArray[np.float64]]:
        """Energy [J] used since the start by the electronics and by each part, each (samples,).

        The names are `true_energy_hotel` and `true_energy_PART`. The mission's true signals give
        the energy.

        Args:
          consumption: losses and hotel load; None takes those of the store's vehicle.

        Raises:
          StoreError: no such mission, or the store holds logs, which lack the true signals."""
        if self.logged:
            raise StoreError(f"store {self.path} holds logs, which say nothing of energy")
        self.check_mission(mission)
        vehicle, samples = self.vehicle, int(self.samples[mission])
        names = needed_signals(vehicle)
        signals = {name: self.row(name, mission)[:samples].astype(float) for name in names}
        losses = Consumption.of(vehicle) if consumption is None else consumption
        return losses.signals(vehicle, signals, sample_times(samples, self.period))

    def signals(self) -> list[str]:
        """Names of the signals (mission, time), in the schema's order."""
        found, sampled = self.dataset, (MISSION, TIME)
        return [name for name in VARIABLES if name in found and found[name].dims == sampled]

    def row(self, name: str, mission: int) -> NDArray[np.float32]:
        """Read one signal of one mission, with padding, (time,).

        Raises:
          StoreError: a file of the signal is missing, or the mission's chunk is damaged.
        """
        self._check_whole(name)
        try:
            return np.asarray(self.dataset[name][mission].values)
        except Exception as error:  # any error of a decoder means damaged files
            reason = " ".join(str(error).split())
            raise StoreError(
                f"store {self.path}: {name} of mission {mission} cannot be read "
                f"({type(error).__name__}: {reason})"
            ) from error

    def rows(self, name: str, missions: Sequence[int] | NDArray[np.intp]) -> NDArray[Any]:
        """Read one signal of some missions, with padding, (mission, time).

        Raises:
          StoreError: a file of the signal is missing or cannot be decoded.
        """
        self._check_whole(name)
        wanted = np.asarray(missions, np.int64)
        if not wanted.size:
            return self._span(name, slice(0, 0))
        order = np.unique(wanted)
        near = max(READ_ALONG // max(self.dataset.sizes.get(TIME, 1), 1), 1)
        runs = np.split(order, np.flatnonzero(np.diff(order) > near) + 1)
        parts = [self._span(name, slice(run[0], run[-1] + 1))[run - run[0]] for run in runs]
        found: NDArray[Any] = np.concatenate(parts)
        return found if np.array_equal(order, wanted) else found[np.searchsorted(order, wanted)]

    def _span(self, name: str, missions: slice) -> NDArray[Any]:
        some = self.dataset[[name]].isel({MISSION: missions}).transpose(MISSION, TIME)
        return read_array(some, name, self.path)

    def _check_whole(self, name: str) -> None:
        """Raise StoreError if files of an array are missing; each array is checked once."""
        if name in self.dataset.variables and name not in self._whole:
            check_chunks(self.dataset, name, self.path)
            self._whole.add(name)

    def check_possible(
        self, name: str, values: NDArray[Any], *, mission: int, advice: str = ""
    ) -> None:
        """Refuse an impossible value of a channel: a single one would ruin a network's scaling.

        Args:
          values: samples of the channel, (time,); NaN is accepted.
          advice: further advice for the error message.

        Raises:
          StoreError: names the channel, mission, sample and possible values.
        """
        if name not in VARIABLES:
            return
        low, high = recorded_limits(name)
        for first in np.flatnonzero((values < low) | (values > high))[:1]:
            unit = f" {VARIABLES[name].units}".removesuffix(" 1")
            raise StoreError(
                f"store {self.path}: channel {name} of mission {mission} is {values[first]:.3g} at "
                f"sample {first} ({first * self.period:.1f} s), possible are {low:g} to "
                f"{high:g}{unit}; repair the store{advice}"
            )

    def gone_arrays(self) -> list[str]:
        """Names of arrays in the store's metadata whose own files are missing."""
        return gone_arrays(self.dataset, self.path)

    def check_arrays(self) -> None:
        """Raise StoreError if files of any array are missing."""
        check_arrays(self.dataset, self.path)

    def check_mission(self, mission: int) -> None:
        """Raise StoreError if there is no such mission."""
        check_mission(mission, len(self), f"store {self.path}")

    def check_filled(self) -> None:
        """Raise StoreError if the store has no missions."""
        check_filled(len(self), f"store {self.path}")
