"""Page of a health check: a verdict for each deployment, each kind of fault, and every belief."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glider_twin_ops.health.answers import Answers
from glider_twin_ops.health.assessment import DeploymentHealth, KindVerdict
from glider_twin_ops.health.channels import CHANNELS
from twin.cli import format_number
from twin.numbers import Array
from twin.show import Page, style
from twin.show.style import LABEL, draw_dates

FEW = 4
"""Deployments of which each is shown with all its channels; of more, those with an alarm"""
HOUR = 3600.0
"""[s]"""
BAND = 2.0
"""Standard deviations of a level or a belief that are shown about it"""
SMALL = (4.1, 1.75)
"""[inch] of a figure that stands beside another"""
BELIEVED = {
    "drag": "Drag K_D0 [kg/m]",
    "neutral_density": "Density of the water in which it neither sinks nor rises [kg/m3]",
}


def write_health(
    folder: Path,
    found: Sequence[DeploymentHealth],
    command: str = "",
    answered: Mapping[str, Answers] | None = None,
) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Args:
      answered: by the name of the deployment, see `glider_twin_ops.health.answer_for`.

    Raises:
      WriteError: something that is no page is in the way.
    """
    alarms = sum(one.alarm for one in found)
    page = Page(
        folder,
        "Is something wrong with the vehicle?",
        "Each dive gives numbers that a sound vehicle repeats. A fault is called where what it "
        "does to them, by flights of the twin, is likelier than drift.",
    )
    page.numbers(
        {
            "deployments": str(len(found)),
            "with an alarm": str(alarms),
            "days": f"{sum(one.days for one in found):.1f}",
        }
    )
    if len(found) > 1:
        page.points([one.verdict() for one in found])
    for one in found:
        _deployment(page, one, (answered or {}).get(one.name), one.alarm or len(found) <= FEW)
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def _deployment(page: Page, one: DeploymentHealth, said: Answers | None, whole: bool) -> None:
    page.section(one.name)
    page.say(one.verdict())
    if one.remarks:
        page.points(one.remarks)
    if one.kinds:
        page.say(
            "Every fault that the vehicle can have and this log can show. Those that show in what "
            "is far off its level in the last dive come first, then the likeliest:"
        )
        for place, kind in enumerate(one.kinds):
            summary = f"{kind.probability:.1%} {kind.says} ({kind.kind})"
            page.details(summary, kind_facts(kind), shown=one.alarm and place == 0)
        page.figure(f"{one.name}-evidence", evidence_figure(one),
                    "Log of the odds of a fault after each dive, and the level of an "
                    "alarm, which two dives in a row make. After the others nothing "
                    "speaks for a fault.")  # fmt: skip
    if said is not None:
        _answers(page, one.name, said)
    if one.kinds and whole:
        told = [k for k, column in enumerate(one.values.T) if np.isfinite(column).any()]
        page.section(f"{one.name}: what each dive says")
        page.say("Each number in each dive, and its level with two standard deviations.")
        page.pair(channel_figures(one, told, one.name))
    if one.lacking:
        page.say(f"The log does not tell: {', '.join(one.lacking)}.")


def kind_facts(kind: KindVerdict) -> dict[str, object]:
    """Names and values of what the dives say of a kind of fault."""
    unit = "" if kind.unit == "1" else f" {kind.unit}"
    return {
        "probability": format_number(kind.probability, 3),
        "since dive": kind.since_dive,
        "size": f"{format_number(kind.size, 3)} +- {format_number(kind.size_deviation, 2)}{unit}",
        "shows in": ", ".join(kind.channels) or "nothing of this log",
        "dives to look at": ", ".join(map(str, kind.dives)) or "-",
        "what else looks like it": kind.otherwise,
        "to find out": kind.find_out,
        "not told apart from": ", ".join(kind.also) or "-",
    }


def _answers(page: Page, name: str, said: Answers) -> None:
    """Drag, compass, pump and energy."""
    page.section(f"{name}: drag, compass, pump, energy")
    if said.beliefs is not None:
        page.pair([(f"{name}-{key}", belief_figure(said, key), f"{text}: after each dive with two "
                    "standard deviations, and looking back (dashed).")
                   for key, text in BELIEVED.items()])  # fmt: skip
    if said.drag is not None:
        page.say(
            f"Drag changed by {100.0 * said.drag['change']:+.1f} +- "
            f"{100.0 * said.drag['change_deviation']:.1f} % from the first dive to the last."
        )
    if said.compass is not None:
        page.say(
            f"Compass: iron of {said.compass['iron_deg']:.1f} +- "
            f"{said.compass['iron_deviation_deg']:.1f} degree, largest on heading "
            f"{said.compass['largest_at_deg']:.0f}."
        )
        page.table(
            [
                {"heading": f"{at['heading_deg']:.0f}",
                 "true less compass": f"{at['deviation_deg']:+.1f}",
                 "+-": f"{at['standard_deviation_deg']:.1f}"}
                for at in said.compass["by_heading"]
            ], "Compass by heading, in degree, from the currents between fixes.", first=False,
        )  # fmt: skip
    if said.pump is not None:
        page.table(
            [
                {"depth [m]": f"{at['from_m']:.0f} to {at['to_m']:.0f}",
                 "rate [cm3/s]": at["rate_cm3_s"], "+-": at["rate_cm3_s_deviation"],
                 "power [W]": at.get("power_w"), "+- [W]": at.get("power_w_deviation"),
                 "samples": int(at["samples"])}
                for at in said.pump
            ], "Pump, by depth.", first=False,
        )  # fmt: skip
    if said.energy is not None:
        page.table(
            [
                {"device": device, "energy [kW h]": at["energy_kwh"], "factor": at["value"],
                 "+-": at["deviation"], "unit": at["unit"]}
                for device, at in said.energy["devices"].items()
            ], f"Energy by device; {said.energy['power_w']:.2f} W in the mean.", first=False,
        )  # fmt: skip
    if said.lacking:
        page.facts({f"no {what}": why for what, why in said.lacking.items()})


def evidence_figure(one: DeploymentHealth) -> Figure:
    """Evidence over the dives."""
    hours = (one.time - one.time[0]) / HOUR
    known = np.isfinite(one.evidence)
    with style.styled():
        figure = style.new_figure(6.0, 2.0)
        axes = figure.add_subplot()
        axes.plot(hours[known], one.evidence[known], ".-", color=style.COMMAND, lw=1.0, ms=4.0)
        axes.axhline(one.threshold, color=style.PALETTE["vermillion"], lw=1.0, label="alarm")
        axes.set_ylabel("log odds of a fault")
        axes.legend(loc="upper left")
        draw_dates(axes, float(one.time[0]), HOUR)
        axes.set_xlabel(LABEL)
    return figure


def channel_figures(
    one: DeploymentHealth, which: Sequence[int], name: str
) -> list[tuple[str, Figure, str]]:
    """Channels that the log tells, with their levels: name, figure and caption of each."""
    hours = (one.time - one.time[0]) / HOUR
    begun = one.dives.index(one.since_dive) if one.alarm and one.since_dive is not None else None
    found = []
    for k in which:
        seen = np.isfinite(one.values[:, k])
        after = slice(int(np.argmax(seen)), None)
        with style.styled():
            figure = style.new_figure(*SMALL)
            axes = figure.add_subplot()
            _band(axes, hours[after], one.levels.level[after, k], one.levels.deviation[after, k])
            axes.plot(hours[seen], one.values[seen, k], ".", color=style.COMMAND, ms=4.0)
            if begun is not None:
                axes.axvline(hours[begun], color=style.PALETTE["vermillion"], lw=0.9)
            draw_dates(axes, float(one.time[0]), HOUR)
        channel = CHANNELS[k]
        unit = "" if channel.unit == "1" else f" [{channel.unit.replace(' s-1', '/s')}]"
        caption = f"{channel.name}{unit}: {channel.says}."
        found.append((f"{name}-{channel.name}", figure, caption))
    return found


def belief_figure(said: Answers, name: str) -> Figure:
    """A belief after each dive with its band, and by all dives."""
    assert said.beliefs is not None
    hours = (said.time - said.time[0]) / HOUR
    value, off = said.beliefs.value(name), said.beliefs.deviation(name)
    back = said.beliefs.value(name, smoothed=True)
    with style.styled():
        figure = style.new_figure(*SMALL)
        axes = figure.add_subplot()
        _band(axes, hours, value, off)
        axes.plot(hours, back, "--", color=style.COMMAND, lw=0.9)
        # the first dives know little: their bands would hide the others
        low, high = (np.quantile(value + side * BAND * off, q) for side, q in ((-1, 0.1), (1, 0.9)))
        axes.set_ylim(min(low, back.min()) - 0.1 * (high - low),
                      max(high, back.max()) + 0.1 * (high - low))  # fmt: skip
        draw_dates(axes, float(said.time[0]), HOUR)
    return figure


def _band(axes: Axes, hours: Array, value: Array, deviation: Array) -> None:
    blue = style.PALETTE["blue"]
    axes.fill_between(hours, value - BAND * deviation, value + BAND * deviation, color=blue,
                      alpha=0.2, lw=0.0)  # fmt: skip
    axes.plot(hours, value, color=blue, lw=1.0)
