"""Damage of logs: functions that damage a log with random numbers, each in one manner.

They damage bytes, text, archives, and columns, cells, attributes, shapes and clocks of tables and
netCDF. Files of messages are written from a flight that is damaged already.
"""

from __future__ import annotations

import dataclasses
import gzip
import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from logs import SOUND, pack

from factory.samples import MAPPING, Flight

Array = Any
Random = np.random.Generator

NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e30, 9.96921e36, -9999.0, 99999.0, 0.0, -1.0,
           1e-310, 500.0, 3.0e9)  # fmt: skip
WORDS = ("", "nan", "inf", "1e400", "x", '"', "9" * 400, "\0", "--", "1,5", "-", "0x1A", "null",
         "2023-13-45", "\u202e", "1_0", "!", "../../escaped", "/tmp/escaped", "é" * 9)  # fmt: skip
UNITS = ("m", "cm", "km", "feet", "fathom", "rad", "degrees", "dbar", "bar", "psi", "Pa", "K",
         "degF", "s", "ms", "days", "percent", "knots", "1e3", "", " ", "furlong",
         "days since 0001-01-01", "seconds since yesterday", "nanoseconds since 1970-01-01",
         "hours since 2100-02-30T00:00:00Z")  # fmt: skip
NAMES = ("units", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range",
         "scale_factor", "add_offset", "positive", "calendar", "standard_name", "long_name",
         "flag_values", "_Unsigned", "axis", "source", "ancillary_variables")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Damaged(Flight):
    """Sound flight with one signal, or the clock, wrong from some moment."""

    dives: int = SOUND.dives
    surface: float = SOUND.surface
    swing: float = SOUND.swing
    signal: str = ""
    change: Callable[[Array], Array] = np.asarray
    clock: Callable[[Array], Array] | None = None

    @property
    def time(self) -> Array:
        return super().time if self.clock is None else self.clock(super().time)

    def state(self, time: Array) -> dict[str, Array]:
        if self.clock is not None:  # the vehicle flies on, whatever the clock shows
            right = dict(zip(self.time.tolist(), super().time.tolist(), strict=False))
            time = np.array([right.get(one, one) for one in np.asarray(time).tolist()])
        found = super().state(time)
        if self.signal:
            found[self.signal] = self.change(np.asarray(found[self.signal], float))
        return found


def changed_values(random: Random) -> Callable[[Array], Array]:
    """Make a function that damages a column of numbers."""
    word, part = float(random.choice(NUMBERS)), random.random(2)
    factor = float(random.choice([-1.0, 0.0, 10.0, 1e3, 1e6, 1e-3, 57.29578, 0.3048]))
    how = random.integers(5)

    def change(values: Array) -> Array:
        values = np.array(values, float)
        flat = values.reshape(-1)
        first, last = np.sort((part * (flat.size + 1)).astype(int))
        if how == 0:  # a range of samples
            flat[first:last] = word
        elif how == 1:  # single samples
            flat[first : first + 1] = word
            flat[last - 1 : last] = word
        elif how == 2:
            flat[:] = word
        elif how == 3:
            flat *= factor
        else:
            flat[first:] += word
        return values

    return change


def changed_clock(random: Random) -> Callable[[Array], Array]:
    """Make a function that damages times of any unit and epoch."""
    step = float(random.choice([1.0, 3600.0, 1e6, 1e9, 1e12, 1e300])) * random.choice([-1, 1])
    part, how = random.random(2), random.integers(9)

    def change(time: Array) -> Array:
        time = np.array(time, float)
        if time.size < 2:
            return time
        first, last = np.sort((part * time.size).astype(int))
        if how == 0:
            time[first:] += step
        elif how == 1:
            time[first : last + 1] += step
        elif how == 2:
            time[first : first + 1] += step
        elif how == 3:
            time[first : last + 1] = time[first]
        elif how == 4:
            time = time[::-1].copy()
        elif how == 5:
            time[first : last + 1] = time[first : last + 1][::-1]
        elif how == 6:
            time -= time[0]
        elif how == 7:
            time *= float(10.0 ** (3 * (1 + int(3 * part[0]))))
        else:
            time[first : last + 1] = np.nan
        return time

    return change


def damaged_flight(random: Random) -> Flight:
    """Flight with implausible signals."""
    if random.integers(3) == 0:
        return Damaged(clock=changed_clock(random))
    signal = str(random.choice(["depth", "pitch", "pump", "heading", "north", "east", "under"]))
    return Damaged(signal=signal, change=changed_values(random))


# --- bytes ---------------------------------------------------------------------------------------


def bits(random: Random, data: bytes) -> bytes:
    """Flip some bits; half of the changes are in the first thousand bytes."""
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 9))):
        most = len(data) if random.integers(2) else min(1000, len(data))
        changed[int(random.integers(most))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def block(random: Random, data: bytes) -> bytes:
    """Cut off, remove, double, zero, move or overwrite a block."""
    first, last = sorted(int(one) for one in random.integers(0, len(data) + 1, 2))
    inside = data[first:last]
    return [
        data[:first], data[first:], data[:first] + data[last:], data[:last] + data[first:],
        data[:first] + bytes(last - first) + data[last:],
        data[:first] + random.bytes(min(last - first, 4096)) + data[last:],
        data[:first] + data[last:] + inside, data + data,
    ][int(random.integers(8))]  # fmt: skip


def text(random: Random, data: bytes) -> bytes:
    """Replace a number or word of a file's text by another or by nonsense."""
    most = len(data) if random.integers(2) else 4000
    found = list(re.finditer(rb"[\w.+-]{2,40}", data[:most]))
    if not found:
        return bits(random, data)
    one = found[int(random.integers(len(found)))]
    other = found[int(random.integers(len(found)))][0]
    word = other if random.integers(4) == 0 else str(random.choice(WORDS)).encode()
    if random.integers(2):  # of the same length
        word = word[: len(one[0])].ljust(len(one[0]), b"!")
    return data[: one.start()] + word + data[one.end() :]


def packed(random: Random, path: Path) -> None:
    """Put the file into an archive: twice, cut off, damaged, or unpacking to a hundred times."""
    data, how = path.read_bytes(), int(random.integers(8))
    if how == 0:  # Slocum's own compression, some with zeros at the end
        data = pack(data + bytes(int(random.choice([0, 2**20, 2**26]))))
        path.with_suffix(f".{path.suffix[1:2]}cd").write_bytes(data)
        path.unlink()
        return
    if how == 1:
        inside = io.BytesIO()
        with zipfile.ZipFile(inside, "w") as archive:
            archive.writestr(path.name, data)
        path.write_bytes(inside.getvalue())
        return
    tail = {2: bytes(2**27), 3: data[len(data) // 2 :] * (2**26 // len(data)), 4: b"9" * 2**26}
    once = gzip.compress(data + tail.get(how, b""), 1)
    if how == 5:
        once = gzip.compress(once)
    elif how == 6:
        once = block(random, once)
    elif how == 7:
        once = bits(random, once)
    name = path.name if path.suffix == ".gz" else f"{path.name}.gz"
    path.unlink()
    path.with_name(name).write_bytes(once)


# --- columns -------------------------------------------------------------------------------------


@dataclasses.dataclass
class Column:
    """Column of a table, or variable of a netCDF file."""

    values: Array
    dimensions: tuple[str, ...] = ("row",)
    attributes: dict[str, Any] = dataclasses.field(default_factory=dict)


Columns = dict[str, Column]


def read_columns(path: Path) -> Columns | None:
    """Read the columns of a file; None for a file that is neither table nor netCDF."""
    data = path.read_bytes()
    if data[:4] in (b"\x89HDF", b"CDF\1", b"CDF\2") or data[512:516] == b"\x89HDF":
        import netCDF4

        with netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            groups = {"": file, **{f"{name}/": one for name, one in file.groups.items()}}
            found = {"/": Column(np.zeros(0), (), {n: file.getncattr(n) for n in file.ncattrs()})}
            for prefix, group in groups.items():
                for name, one in group.variables.items():
                    attributes = {n: one.getncattr(n) for n in one.ncattrs()}
                    found[prefix + name] = Column(one[...], one.dimensions, attributes)
            return found
    if path.suffix.lower() in (".csv", ".gz"):
        words = gzip.decompress(data) if path.suffix == ".gz" else data
        rows = [line.split(",") for line in words.decode().splitlines()]
        cells = [row for row in rows[1:] if len(row) == len(rows[0])]
        if len(rows[0]) > 2 and cells:
            columns = np.array(cells, object).T
            return {name: Column(one) for name, one in zip(rows[0], columns, strict=True)}
    return None


def write_columns(path: Path, columns: Columns) -> None:
    """Write the file again, with these columns."""
    whole = columns.pop("/", None)
    if whole is None:
        rows = zip(*(column.values.tolist() for column in columns.values()), strict=False)
        lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
        data = ("\n".join(lines) + "\n").encode("utf-8", "replace")
        path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
        return
    import netCDF4

    path.unlink()
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts(whole.attributes)
        for name, column in columns.items():
            prefix, _, bare = name.rpartition("/")
            group = file.createGroup(prefix) if prefix else file
            values, dimensions = np.asarray(column.values), []
            for dimension, size in zip(column.dimensions, values.shape, strict=True):
                known = group.dimensions.get(dimension) or file.dimensions.get(dimension)
                other = known is not None and len(known) != size
                dimensions.append(f"{dimension}_{size}" if other else dimension)
                if dimensions[-1] not in {**group.dimensions, **file.dimensions}:
                    group.createDimension(dimensions[-1], size)
            kind = str if values.dtype.kind in "OU" else values.dtype
            fill = column.attributes.pop("_FillValue", None)
            one = group.createVariable(bare, kind, dimensions, fill_value=fill)
            one.set_auto_maskandscale(False)
            one[...] = values
            one.setncatts(column.attributes)


def _number(values: Array) -> bool:
    return np.asarray(values).dtype.kind in "fiu"


def _numbers(values: Array) -> Array:
    """Numbers of a table's column; NaN for cells without a number."""

    def number(word: Any) -> float:
        try:
            return float(word)
        except ValueError:
            return float("nan")

    if _number(values):
        return np.array(values, float)
    return np.array([number(one) for one in np.ravel(values)]).reshape(np.shape(values))


def _choose(random: Random, columns: Columns, words: str = "") -> str:
    named = [name for name in columns if name != "/" and re.search(words, name, re.IGNORECASE)]
    return str(random.choice(named or [name for name in columns if name != "/"]))


def values(random: Random, columns: Columns) -> None:
    """Damage the values of one column: a factor, an offset, nonsense in one, some or all cells."""
    one = columns[_choose(random, columns)]
    if not _number(one.values) and random.integers(2):
        one.values = np.array(one.values, object)
        flat = one.values.reshape(-1)
        for _ in range(int(random.integers(1, 4))):
            flat[random.integers(flat.size or 1) : flat.size] = str(random.choice(WORDS))
    else:
        one.values = changed_values(random)(_numbers(one.values))


def clock(random: Random, columns: Columns) -> None:
    """Damage the times of one clock."""
    one = columns[_choose(random, columns, "time|stamp|secs|seconds")]
    one.values = changed_clock(random)(_numbers(one.values))


def names(random: Random, columns: Columns) -> None:
    """Drop, rename, double or empty a column, or give it the values of another one."""
    name, other = _choose(random, columns), _choose(random, columns)
    how = int(random.integers(5))
    if how == 0:
        del columns[name]
    elif how == 1:
        columns[str(random.choice(["X", name.upper(), name[:-1] or "x", f"{name}2"]))] = (
            columns.pop(name)
        )
    elif how == 2:
        columns[name], columns[other] = columns[other], columns[name]
    elif how == 3:
        columns[name] = dataclasses.replace(columns[other])
    else:
        empty = np.full_like(columns[name].values, np.nan if _number(columns[name].values) else "")
        columns[name].values = empty


def rows(random: Random, columns: Columns) -> None:
    """Damage the rows of one column or all: fewer, none, one, twice, another order."""
    several = [one for name, one in columns.items() if name != "/"]
    chosen = several if random.integers(2) else [several[int(random.integers(len(several)))]]
    how, part = int(random.integers(6)), random.random()
    for one in chosen:
        if not np.ndim(one.values):
            continue
        size = len(one.values)
        order = np.arange(size)
        take = [
            order[: int(part * size)], order[:0], order[:1], np.repeat(order, 2), order[::-1],
            np.random.default_rng(int(1e6 * part)).permutation(order),
        ][how]  # fmt: skip
        one.values = one.values[take]


def attributes(random: Random, columns: Columns) -> None:
    """Change an attribute of a variable or of the file: unit, fill value, scale, text or none."""
    one = columns[_choose(random, columns) if random.integers(8) else next(iter(columns))]
    if one.attributes and random.integers(4) == 0:
        del one.attributes[str(random.choice(list(one.attributes)))]
        return
    name = str(random.choice([*NAMES, *one.attributes, "units", "units"]))
    value: Any = str(random.choice(UNITS))
    if name != "units" or random.integers(6) == 0:
        value = [
            value, float(random.choice(NUMBERS)), int(random.integers(-5, 5)),
            np.array([1.0, np.nan]), "down", "9" * 400,
        ][int(random.integers(6))]  # fmt: skip
    if name == "_FillValue":
        value = np.asarray(one.values).dtype.type(0) if _number(one.values) else None
    one.attributes[name] = value


def shape(random: Random, columns: Columns) -> None:
    """Change a variable's type or shape: integers, letters, one value, two dimensions."""
    one = columns[_choose(random, columns)]
    kept = np.nan_to_num(_numbers(one.values), posinf=0.0, neginf=0.0)
    how = int(random.integers(7))
    if how < 4:
        kind = ("i1", "u1", "i4", "f4")[how]
        one.values = np.clip(kept, 0.0, 120.0 if how < 2 else 2e9).astype(kind)
    elif how == 4:
        one.values = np.full(kept.shape, "x", object)
    elif how == 5 and kept.size:
        one.values, one.dimensions = kept.reshape(-1)[0], ()
    else:
        one.values, one.dimensions = kept[..., None], (*one.dimensions, "deeper")


BYTES: dict[str, Callable[[Random, bytes], bytes]] = {"bits": bits, "block": block, "text": text}
COLUMNS: dict[str, Callable[[Random, Columns], None]] = {
    "values": values, "clock": clock, "names": names, "rows": rows, "attributes": attributes,
    "shape": shape,
}  # fmt: skip
OPERATIONS = (*BYTES, *COLUMNS, "packed", "flight")


def damage(random: Random, folder: Path, operation: str) -> str:
    """Damage one file of a folder; return its name, or "" if the operation does not fit it."""
    files = sorted(p for p in folder.iterdir() if p.name != MAPPING)
    path = files[int(random.integers(len(files)))]
    if operation in BYTES:
        path.write_bytes(BYTES[operation](random, path.read_bytes()))
    elif operation == "packed":
        packed(random, path)
    else:
        columns = read_columns(path)
        if columns is None or (operation in ("attributes", "shape") and "/" not in columns):
            return ""
        COLUMNS[operation](random, columns)
        write_columns(path, columns)
    return path.name
