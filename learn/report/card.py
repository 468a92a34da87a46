"""Model card: a run's networks, their training data, their errors and their limits.

The card is Markdown with a YAML head, as model hubs read it.

`RunOrigin` has the sentences on the missions or logs that the networks were trained on.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import Any

from learn.data.dataset import SPEED
from learn.data.labels import DEVICES
from learn.report.result_tables import summary_rows, verdicts
from learn.run import MORE_STORES, ORIGIN, TRUTH, Run
from learn.seams import NETWORKS
from twin.cli.console import one_line
from twin.cli.text_table import format_number, printable
from twin.records.attributes import SOURCE_FORMAT, is_logged


class RunOrigin:
    """Sentences for the model card, from `run.json` alone."""

    def __init__(self, description: Mapping[str, Any]) -> None:
        self._description = description
        self._settings: Mapping[str, Any] = description["settings"]
        self._store: Mapping[str, Any] = description["store"]
        self._logs = is_logged(self._store)
        source = self._settings.get("labels", {}).get("source", "truth")
        self._device = DEVICES.get(source, "")

    @property
    def row(self) -> str:
        """Noun for a row of the store: dive or mission."""
        return "dive" if self._logs else "mission"

    @property
    def rows(self) -> str:
        """Plural of `row`."""
        return f"{self.row}s"

    def made_from(self) -> list[str]:
        """Sentences on the stores and runs behind the weights, the last training first."""
        found = [f"store: {self._settings['store']}, {_kind(self._store)}"]
        found += [
            f"further store: {one['store']}, {_kind(one)} of {one['vehicle']}"
            for one in self._description.get(MORE_STORES, ())
        ]
        origin = self._description.get(ORIGIN)
        if origin is None and self._settings.get("start"):
            found.append(
                f"weights to start from: run {self._settings['start']}, of whose store this run "
                "keeps no record"
            )
        while origin is not None:
            found.append(
                f"weights to start from: run {origin['run']}, trained on {origin['store']}, "
                f"{_kind(origin)}"
            )
            origin = origin.get(ORIGIN)
        return found

    def division(self) -> str:
        """Division into training and validation, in words."""
        if self._settings["division"] == "samples":
            return "by samples (leaks between neighbouring samples)"
        return "by blocks of dives" if self._logs else "by missions"

    def units(self) -> str:
        """Sentence on the units and the reference of the table's numbers."""
        if self._logs:
            known = (
                f"against the {self._device}'s cleaned velocities, where it has any"
                if self._device
                else "over the samples that have a truth"
            )
            return (
                f"MSE in (m/s)² {known}; dead reckoning in % of the "
                "horizontal path through the water that depth rate and pitch give, at the fix that "
                "ends a dive."
            )
        return (
            "MSE in (m/s)² over all samples; dead reckoning in % of the horizontal path through "
            "the water at mission end."
        )

    def limits(self) -> list[str]:
        """Sentences on the networks' vehicles, and on the truth behind their training."""
        if not self._logs:
            return [
                "They were trained on simulated missions of the vehicles that the store describes"
                f"{_preset(self._store)}; how they do on a real one, or on another hull, has to be "
                "measured on its logs."
            ]
        platform = self._store.get("platform")
        found = [
            "They were trained on logs"
            + (f" of {platform}" if platform else "")
            + "; another vehicle, or this one with other ballast, wings or payload, needs training "
            "of its own."
        ]
        truth = self._description.get(TRUTH)
        if self._device:
            found.append(
                f"They learned what the {self._device} measured and are judged by it: its errors, "
                "and those of the current that was taken off, are in the networks and figures."
            )
        elif truth is not None and SPEED in truth and "true_surge" not in truth:
            found.append(
                "The logs hold the speed through the water alone: surge was learned from it, and "
                "sway as zero, so that sway is not estimated."
            )
        else:
            found.append(
                "They learned from those samples alone where the logs hold a velocity through the "
                "water; elsewhere nothing was learned, and their errors are unknown."
            )
        return found


def _kind(store: Mapping[str, Any]) -> str:
    """Content of a store in words, from its attributes."""
    if is_logged(store):
        return f"logs of vehicles at sea ({store[SOURCE_FORMAT]})"
    return f"simulated missions{_preset(store)}"


def _preset(store: Mapping[str, Any]) -> str:
    parts = [f"{name} {store[name]}" for name in ("preset", "sensors") if name in store]
    return f" ({', '.join(parts)})" if parts else ""


TRAINED_ON = ("all", "train")
"""Splits with missions that the networks were trained on."""
SEEN = (
    "The networks were trained on samples of what they are judged on here: on what they never saw "
    "they are worse."
)


def model_card(run: Run, evaluation: Mapping[str, Any], split: str) -> str:
    """Text of the model card."""
    settings = run.description["settings"]
    network, training = settings["network"], settings["training"]
    origin = RunOrigin(run.description)
    those = "those stores" if settings.get(MORE_STORES) else "that store"
    lines = [
        "---",
        "tags: [underwater-vehicle, dead-reckoning, time-series]",
        "library_name: pytorch",
        "---",
        "",
        f"# {shown(run.name)}: surge and sway of an underwater vehicle",
        "",
        "Networks that estimate a vehicle's velocity through the water, forward (surge) and to "
        "starboard (sway), from what the vehicle measures and commands. With measured attitude and "
        "depth they give a dead-reckoned track without a Doppler log.",
        "",
        "## Use",
        "",
        "```",
        f"learn evaluate {one_line(run.name)} STORE     # dead reckoning on any store of missions",
        f"learn export {one_line(run.name)}             # ONNX step models for on-board use",
        "```",
        "",
        "## What they are",
        "",
        f"- {settings['members']} network(s) per velocity: {shown(network['kind'])}, "
        f"{_sizes(network)}",
        f"- inputs: {shown(', '.join(settings['features']))}",
        "- output: velocity through the water [m/s], body axes forward and starboard",
        "- free-running: no velocity is fed back; a state starts at zero at the first sample of a "
        f"{origin.row}",
        f"- trained with {shown(training['optimiser'])}, seed {shown(training['seed'])}"
        + (f", every {origin.row} mirrored too" if settings.get("mirror") else ""),
        "",
        "## What they were made from",
        "",
        *(f"- {shown(line)}" for line in origin.made_from()),
        *(f"- {shown(name)}: {shown(value)}" for name, value in run.description["store"].items()),
        f"- division into training and validation: {origin.division()}",
        *(f"- {shown(sentence)}" for sentence in run.label_sentences()),
        "",
        f"## How good they are ({split} {origin.rows} of {those})",
        "",
        *([SEEN, ""] if split in TRAINED_ON else []),
        *_markdown(summary_rows(evaluation)),
        "",
        origin.units(),
        "",
        *(f"- {shown(sentence)}" for sentence in verdicts(evaluation)),
        "",
        "## What they are not",
        "",
        *(f"- {shown(line)}" for line in origin.limits()),
        "- They do not know the current. A steady current leaves no trace in the inputs.",
        f"- Sensor errors that the training {origin.rows} lacked are not covered.",
        "",
    ]
    return "\n".join(lines)


def shown(text: object) -> str:
    """Escape a text for Markdown, as one line without markup and HTML."""
    escaped = html.escape(printable(one_line(str(text))), quote=False)
    return re.sub(r"([\\`*_\[\]|])", r"\\\1", escaped)


def _sizes(network: Mapping[str, Any]) -> str:
    """Sizes that the type of network uses, in words."""
    return ", ".join(f"{size} {network[size]}" for size in NETWORKS[network["kind"]].sizes)


def _markdown(rows: list[dict[str, object]]) -> list[str]:
    columns = list(rows[0])
    cells = [[shown(format_number(row.get(column), 3)) for column in columns] for row in rows]
    return [
        f"| {' | '.join(shown(column) for column in columns)} |",
        f"|{'|'.join('---' for _ in columns)}|",
        *(f"| {' | '.join(line)} |" for line in cells),
    ]
