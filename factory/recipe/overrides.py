"""Overrides: replaced distributions from a TOML file and from NAME=VALUE words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.bounded import read_toml
from twin.errors import InputError


def read_changes(path: Path | None, words: Sequence[str] = ()) -> dict[str, str | float]:
    """Changes by parameter name; words win over the file.

    The file holds tables named after the groups:

        [mission]
        pitch_deg = "uniform(15, 35)"

    Raises:
      InputError: the file cannot be read or is not TOML of this form, or a word has no =.
    """
    changes = {} if path is None else _read_file(path)
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise InputError(
                f"--set {word!r}: write NAME=DISTRIBUTION, such as "
                "mission.pitch_deg='uniform(15, 35)'"
            )
        changes[name.strip()] = value.strip()
    return changes


def _read_file(path: Path) -> dict[str, str | float]:
    data = read_toml(path, "parameter file")
    changes: dict[str, str | float] = {}
    for group, table in data.items():
        if not isinstance(table, Mapping):
            raise InputError(f"{path}: {group} must be a table, such as [mission]")
        for name, value in table.items():
            if isinstance(value, bool) or not isinstance(value, str | int | float):
                raise InputError(f"{path}: {group}.{name} = {value!r}: give a number or a text")
            changes[f"{group}.{name}"] = value
    return changes
