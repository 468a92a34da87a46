"""Proposals: the plan of a forecast as files that a pilot may send to the vehicle.

Nothing is sent: the files lie beside the page. The project's own reader reads them back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from twin.mission import Mission, slocum_arguments, targets_of, targets_text

TARGETS = "targets"
KINDS: Mapping[str, Callable[[Mission], dict[str, str]]] = {
    "slocum": slocum_arguments,
    "seaglider": lambda mission: {TARGETS: targets_text(targets_of(mission))},
}
"""Files by the kind of the logs, which is that of the vehicle"""
NAMES = ("goto_l10.ma", "yo10.ma", "surfac10.ma", TARGETS)
"""Every name that a proposal can have"""


def proposals(kind: str, mission: Mission) -> dict[str, str]:
    """Texts by the names of the files; empty for kinds of log whose vehicle's files are not known.

    Args:
      kind: of the logs, such as slocum.

    Raises:
      MissionError: files of the kind cannot say what the mission asks.
    """
    return KINDS[kind](mission) if kind in KINDS else {}
