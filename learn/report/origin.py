"""Origin: which missions or logs a run's networks were trained on, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from learn.data.logs import SPEED
from learn.runs.run import ORIGIN, TRUTH
from twin.records.attributes import SOURCE_FORMAT, is_logged


class Origin:
    """Sentences that follow from `run.json`, for the model card; nothing is assumed."""

    def __init__(self, description: Mapping[str, Any]) -> None:
        self._description = description
        self._settings: Mapping[str, Any] = description["settings"]
        self._store: Mapping[str, Any] = description["store"]
        self._logs = is_logged(self._store)
        self._by_doppler = self._settings.get("labels", {}).get("source") == "dvl"

    @property
    def row(self) -> str:
        """What a row of the store is."""
        return "dive" if self._logs else "mission"

    @property
    def rows(self) -> str:
        """The same, many."""
        return f"{self.row}s"

    def made_from(self) -> list[str]:
        """Where the weights come from, the last training first."""
        found = [f"store: {self._settings['store']}, {_kind(self._store)}"]
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
        """What is trained on and what is not."""
        if self._settings["division"] == "samples":
            return "by samples (leaks between neighbouring samples)"
        return "by blocks of dives" if self._logs else "by missions"

    def units(self) -> str:
        """What the table's numbers are."""
        if self._logs:
            known = (
                "against the Doppler log's cleaned velocities, where it had lock"
                if self._by_doppler
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
        """For what vehicle they are, and how far their truth goes."""
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
        if self._by_doppler:
            found.append(
                "They learned what the Doppler log measured and are judged by it: its errors, and "
                "those of the current that was taken off, are in the networks and in the figures."
            )
        elif truth is not None and SPEED in truth and "true_surge" not in truth:
            found.append(
                "The logs hold the speed through the water alone: surge was learned from it, and "
                "sway as zero, so that sway is no estimate."
            )
        else:
            found.append(
                "They learned from those samples alone where the logs hold a velocity through the "
                "water; elsewhere nothing was learned and nothing is known of their errors."
            )
        return found


def _kind(store: Mapping[str, Any]) -> str:
    """What a store holds, by its attributes."""
    if is_logged(store):
        return f"logs of vehicles at sea ({store[SOURCE_FORMAT]})"
    return f"simulated missions{_preset(store)}"


def _preset(store: Mapping[str, Any]) -> str:
    parts = [f"{name} {store[name]}" for name in ("preset", "sensors") if name in store]
    return f" ({', '.join(parts)})" if parts else ""
