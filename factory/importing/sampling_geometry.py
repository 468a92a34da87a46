"""Sampling geometry of a netCDF file: every variable at the samples, however the file lays it out.

The layouts are those of CF's chapter 9: a variable along the samples; one value for a profile or a
trajectory whose samples lie one after the other, counted by a variable with `sample_dimension`
(ERDDAP's `rowSize`); an index of the profile at each sample, with `instance_dimension`; arrays of
profiles by samples, padded.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.netcdf import SINCE, as_array, attributes_of, seconds_of
from factory.importing.tally import Tally
from twin.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

COUNTS = ("row_size", "rowsize")
"""Names, in small letters, of counts that say nothing of their dimension"""


class Geometry:
    """Samples of a file, and where along each dimension each of them lies."""

    def __init__(self, file: Any, measured: Sequence[str], subject: str) -> None:
        """Find the samples.

        Args:
          file: open netCDF file.
          measured: names of variables that are measured at the samples; the largest decides.
          subject: file, for errors.

        Raises:
          InputError: counts or indices that do not fit the samples.
        """
        self._variables: Mapping[str, Any] = file.variables
        self._subject = subject
        there = [n for n in measured if n in file.variables and _is_number(file.variables[n])]
        largest = max(there, key=lambda n: int(file.variables[n].size), default=None)
        self._along: dict[str, Index] = {}
        self._own: set[str] = set()  # dimensions of the samples themselves
        self.count = 0
        """Samples, those that pad an array among them"""
        if largest is None or not file.variables[largest].dimensions:
            return
        variable = file.variables[largest]
        self._own = {d for d in variable.dimensions if file.dimensions[d].size > 1}
        self.count = int(variable.size)
        for name, at in zip(variable.dimensions, np.indices(variable.shape), strict=True):
            self._along[name] = at.ravel()
        for name, one in file.dimensions.items():
            if one.size == 1:
                self._along.setdefault(name, np.zeros(self.count, np.int64))
        while self._add_instances():
            pass

    def _add_instances(self) -> bool:
        """Add a dimension whose elements are profiles or trajectories; whether one was found."""
        for name, variable in self._variables.items():
            if len(variable.dimensions) != 1 or variable.dtype == str or variable.dtype.kind != "i":
                continue
            own = variable.dimensions[0]
            counted = getattr(variable, "sample_dimension", None)
            if counted is None and name.lower() in COUNTS:
                rest = [d for d in self._along if d != own]
                counted = rest[0] if len(rest) == 1 else None
            named = getattr(variable, "instance_dimension", None)
            if counted in self._along and own not in self._along:
                self._along[own] = self._counted(name, str(counted))
                return True
            if own in self._along and named is not None and named not in self._along:
                index = as_array(variable[:])[self._along[own]]
                self._along[str(named)] = self._whole(index, name)
                return True
        return False

    def _counted(self, name: str, counted: str) -> Index:
        """Of each sample the element that counts it."""
        counts = self._whole(as_array(self._variables[name][:]), name)
        along = self._along[counted]
        if counts.sum() != (along.max() + 1 if along.size else 0):
            raise InputError(
                f"{self._subject} is damaged: {name} counts {counts.sum()} samples, and "
                f"{counted} has {along.max() + 1 if along.size else 0}"
            )
        return np.repeat(np.arange(len(counts)), counts)[along]

    def _whole(self, values: Array, name: str) -> Index:
        if not np.isfinite(values).all() or (values < 0).any():
            raise InputError(f"{self._subject} is damaged: {name} has elements without a number")
        return values.astype(np.int64)

    def reaches(self, name: str) -> bool:
        """Whether the variable has numbers at the samples."""
        variable = self._variables.get(name)
        return (
            variable is not None
            and _is_number(variable)
            and bool(self.count)
            and set(variable.dimensions) <= set(self._along)
        )

    def single(self, name: str) -> bool:
        """Whether the variable has one value for several samples."""
        return not self._own <= set(self._variables[name].dimensions)

    def column(self, name: str) -> Array:
        """Numbers of a variable, (samples,); of one that `reaches` them."""
        return self._at(name, as_array(self._variables[name][...]))

    def texts(self, name: str) -> NDArray[np.object_] | None:
        """Texts of a variable, (samples,), a number as it is written; None: it has none there."""
        variable = self._variables.get(name)
        if variable is None or not self.count:
            return None
        values, dimensions = variable[...], variable.dimensions
        if getattr(values, "dtype", None) is not None and values.dtype.kind == "S" and dimensions:
            letters = np.ascontiguousarray(np.ma.filled(values, b""))
            values = letters.view(f"S{max(letters.shape[-1], 1)}")[..., 0]
        if np.ndim(values) < len(dimensions):  # the last dimension is of letters
            dimensions = dimensions[:-1]
        if not set(dimensions) <= set(self._along):
            return None
        words = np.array([_text(one) for one in np.ma.filled(values).ravel()], object)
        shape = np.shape(values)
        found = words.reshape(shape)[tuple(self._along[d] for d in dimensions)] if shape else words
        return np.broadcast_to(found, (self.count,))

    def _at(self, name: str, values: Array) -> Array:
        variable = self._variables[name]
        index = tuple(self._along[d] for d in variable.dimensions)
        try:
            found = values.reshape(variable.shape)[index] if index else values
        except IndexError as error:
            raise InputError(
                f"{self._subject} is damaged: {name} has fewer elements than its index names"
            ) from error
        return np.array(np.broadcast_to(found, (self.count,)), np.float64)

    def clocks(self, usual: str, tally: Tally) -> dict[str, Array]:
        """Times [s] unix of all variables of time that reach the samples, the usual one first."""
        names = [n for n in self._variables if self.reaches(n) and self._is_time(n, usual)]
        names.sort(key=lambda name: name != usual)
        found = {}
        for name in names:
            said = attributes_of(self._variables[name])
            if name == usual:
                found[name] = seconds_of(self.column(name), said, self._subject, tally)
                continue
            with contextlib.suppress(InputError):  # no clock: it has units that are none
                found[name] = seconds_of(self.column(name), said, self._subject, Tally())
        return found

    def _is_time(self, name: str, usual: str) -> bool:
        units = str(getattr(self._variables[name], "units", ""))
        return name == usual or SINCE in units


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 ")
    return f"{value:g}" if isinstance(value, (int, float, np.number)) else str(value).strip("\0 ")


def _is_number(variable: Any) -> bool:
    return variable.dtype != str and getattr(variable.dtype, "kind", "") in "fiu"
