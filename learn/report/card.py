"""Model card: what a run's networks are, their training data, how good they are, their limits.

Markdown with a YAML head, as model hubs read it.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import Any

from learn.networks.registry import NETWORKS
from learn.report.origin import Origin
from learn.report.tables import summary_rows, verdicts
from learn.runs.run import Run
from twin.cli.console import one_line
from twin.cli.text_table import format_number

TRAINED_ON = ("all", "train")
"""Splits that hold missions that the networks were trained on."""
SEEN = (
    "The networks were trained on samples of what they are judged on here: on what they never saw "
    "they are worse."
)


def model_card(run: Run, evaluation: Mapping[str, Any], split: str) -> str:
    """The card's text."""
    settings = run.description["settings"]
    network, training = settings["network"], settings["training"]
    origin = Origin(run.description)
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
        f"## How good they are ({split} {origin.rows} of that store)",
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
        "- They know nothing of the current. A steady current leaves no trace in the inputs.",
        f"- Sensor errors that the training {origin.rows} lacked are not covered.",
        "",
    ]
    return "\n".join(lines)


def shown(text: object) -> str:
    """A text of a store or a run as Markdown that shows it: no markup, no HTML, one line."""
    escaped = html.escape(one_line(str(text)), quote=False)
    return re.sub(r"([\\`*_\[\]|])", r"\\\1", escaped)


def _sizes(network: Mapping[str, Any]) -> str:
    """The sizes that its kind uses."""
    return ", ".join(f"{size} {network[size]}" for size in NETWORKS[network["kind"]].sizes)


def _markdown(rows: list[dict[str, object]]) -> list[str]:
    columns = list(rows[0])
    cells = [[shown(format_number(row.get(column), 3)) for column in columns] for row in rows]
    return [
        f"| {' | '.join(shown(column) for column in columns)} |",
        f"|{'|'.join('---' for _ in columns)}|",
        *(f"| {' | '.join(line)} |" for line in cells),
    ]
