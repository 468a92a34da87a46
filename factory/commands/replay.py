"""`factory replay`: a stored mission flown again, compared byte for byte."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument


@dataclass(frozen=True, kw_only=True)
class ReplayMission(JsonOption):
    """Fly stored missions again from what the store holds and compare every byte.

    Example:

        factory replay data/missions.zarr --mission 0 4
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""
    mission: tuple[int, ...] = (0,)
    """missions to fly again"""
    attempt: int | None = None
    """fly this failed attempt at the mission instead, to see it fail"""

    def run(self, console: Console) -> int:
        """Replay; exit code 1 when a byte differs."""
        from factory.flown_again import replay_failure, replay_mission
        from factory.generation import GeneratedStore

        run = GeneratedStore(self.store)
        if self.attempt is not None:
            then, now = replay_failure(run, self.mission[0], self.attempt)
            console.say(f"then: {then}\nnow:  {now}")
            console.answer(then=then, now=now, identical=then == now)
            return 0 if then == now else 1
        results = [replay_mission(run, mission) for mission in self.mission]
        for other in results[0].other_versions if results else ():
            console.warn(f"the store was made with another version, bits may differ: {other}")
        for result in results:
            if result.identical:
                console.say(
                    f"mission {result.mission}: identical, {result.signals} signals of "
                    f"{result.samples} samples, {result.bytes_compared} bytes"
                )
            else:
                worst = sorted(result.different.items(), key=lambda item: -item[1])
                text = ", ".join(f"{name} (up to {gap:.3g})" for name, gap in worst)
                console.say(f"mission {result.mission}: DIFFERENT in {len(worst)} signals: {text}")
        identical = all(result.identical for result in results)
        console.answer(
            store=self.store,
            identical=identical,
            missions=[
                {"mission": r.mission, "identical": r.identical, "different": r.different}
                for r in results
            ],
        )
        return 0 if identical else 1
