"""Card: what a run's networks are and came from, how good they are, and what they are not.

Markdown with a YAML head, as model hubs read it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from learn.report.tables import summary_rows, verdicts
from learn.runs.run import Run
from twin.cli.text_table import format_number


def model_card(run: Run, evaluation: Mapping[str, Any], split: str) -> str:
    """The card's text."""
    settings = run.description["settings"]
    network, training = settings["network"], settings["training"]
    lines = [
        "---",
        "tags: [underwater-glider, dead-reckoning, time-series]",
        "library_name: pytorch",
        "---",
        "",
        f"# {run.name}: surge and sway of an underwater glider",
        "",
        "Networks that estimate a glider's velocity through the water, forward (surge) and to "
        "starboard (sway), from what the vehicle measures and commands. With measured attitude and "
        "depth they give a dead-reckoned track without a Doppler log.",
        "",
        "## Use",
        "",
        "```",
        f"learn evaluate {run.name} STORE     # dead reckoning on any store of missions",
        f"learn export {run.name}             # ONNX step models for on-board use",
        "```",
        "",
        "## What they are",
        "",
        f"- {settings['members']} network(s) per velocity: {network['kind']}, "
        f"{network['layers']} hidden layers of {network['hidden']}",
        f"- inputs: {', '.join(settings['features'])}",
        "- output: velocity through the water [m/s], body axes forward and starboard",
        "- free-running: no velocity is fed back, the state starts at zero at launch",
        f"- trained with {training['optimiser']}, seed {training['seed']}",
        "",
        "## What they were made from",
        "",
        f"- store: {settings['store']}",
        *(f"- {name}: {value}" for name, value in run.description["store"].items()),
        f"- division into training and validation: by {settings['division']}"
        + (" (leaks between neighbouring samples)" if settings["division"] == "samples" else ""),
        "",
        f"## How good they are ({split} missions of that store)",
        "",
        *_markdown(summary_rows(evaluation)),
        "",
        "MSE in (m/s)² over all samples; dead reckoning in % of the horizontal path through the "
        "water at mission end.",
        "",
        *(f"- {sentence}" for sentence in verdicts(evaluation)),
        "",
        "## What they are not",
        "",
        "- They were trained on simulated missions of one vehicle; another hull, or this one with "
        "a payload outside, needs training anew.",
        "- They know nothing of the current. A steady current leaves no trace in the inputs.",
        "- Sensor errors that the training missions lacked are not covered.",
        "",
    ]
    return "\n".join(lines)


def _markdown(rows: list[dict[str, object]]) -> list[str]:
    columns = list(rows[0])
    cells = [[format_number(row.get(column), 3) for column in columns] for row in rows]
    return [
        f"| {' | '.join(column.strip() for column in columns)} |",
        f"|{'|'.join('---' for _ in columns)}|",
        *(f"| {' | '.join(line)} |" for line in cells),
    ]
