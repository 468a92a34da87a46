"""Result tables: numbers of an evaluation as rows and sentences, for a terminal or a page.

The functions read the JSON object of `learn evaluate`, so they do not need the run's store.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from learn.evaluation.score import NETWORK
from learn.report.contents import KNOWLEDGE_TITLES, title_of
from twin.cli.text_table import counted
from twin.navigation.estimators.base import baselines

if TYPE_CHECKING:
    from learn.run import Run
    from twin.cli.console import Console

Figures = Mapping[str, Any]
Row = dict[str, object]

PAPER = {"surge_mse": 2.12e-4, "sway_mse": 4.59e-6}
"""[(m/s)^2] Errors of the paper's glider networks (table II), on samples that it does not state."""
PAPER_PROPELLED = {"surge_mse": 3.47e-2, "sway_mse": 5.88e-3}
"""[(m/s)^2] Errors of the paper's networks for Tethys (its first study), against a Doppler log."""
STILL_PERCENT = 1e-6
"""[% of the path] Water is still if the true tracks over ground and through it differ by no
more."""


def methods_of(evaluation: Figures) -> Iterator[tuple[str, Figures]]:
    """Names and numbers of the networks, `floor` (true velocities), and baselines with a number."""
    yield "network", evaluation
    yield "floor", evaluation["floor"]
    for name, figures in evaluation["baselines"].items():
        if any(v is not None for k, v in figures.items() if k.endswith(("_mse", "_mean"))) or any(
            dives["dives"] for dives in figures["dives"].values()
        ):
            yield name, figures


def velocity_rows(evaluation: Figures) -> list[Row]:
    """Rows of mean squared errors of surge and sway, one per method."""
    rows = []
    for name, figures in methods_of(evaluation):
        if figures["surge_mse"] is None or name == "floor":
            continue
        rows.append(
            {
                "method": title_of(name),
                "surge MSE [(m/s)²]": figures["surge_mse"],
                "after 30 s": figures["surge_mse_after_30s"],
                "sway MSE [(m/s)²]": figures["sway_mse"],
                "after 30 s ": figures["sway_mse_after_30s"],
            }
        )
    return rows


def printed_row(paper: Mapping[str, float]) -> Row:
    """Row of `velocity_rows` with the paper's errors, `PAPER` or `PAPER_PROPELLED`."""
    conditions = " (ideal sensors, nominal vehicle)" if paper is PAPER else ""
    return {
        "method": f"the paper's networks, as printed{conditions}",
        "surge MSE [(m/s)²]": paper["surge_mse"],
        "sway MSE [(m/s)²]": paper["sway_mse"],
    }


def paper_sentence(paper_test: Figures) -> str:
    """Sentence that compares the networks on the paper's test with the paper's own."""
    ours, theirs = (
        f"surge {found['surge_mse']:.1e}, sway {found['sway_mse']:.1e}"
        for found in (paper_test, PAPER)
    )
    return (
        f"The paper's test, nominal vehicle and the store's sensors: MSE {ours} (m/s)². The paper "
        f"prints {theirs} of its own networks, with ideal sensors and the nominal vehicle."
    )


def track_rows(evaluation: Figures, track: str) -> list[Row]:
    """Rows of dead-reckoning errors, one per method; `track` is water, velocity or ground."""
    rows = []
    for name, figures in methods_of(evaluation):
        if figures[f"dr_{track}_percent_mean"] is None:
            continue
        rows.append(
            {
                "method": title_of(name),
                "mean [%]": figures[f"dr_{track}_percent_mean"],
                "median [%]": figures[f"dr_{track}_percent_median"],
                "p90 [%]": figures[f"dr_{track}_percent_p90"],
                "largest on the way, mean [%]": figures[f"dr_{track}_max_percent_mean"],
                "mean [m]": figures[f"dr_{track}_m_mean"],
                "p90 [m]": figures[f"dr_{track}_m_p90"],
            }
        )
    return rows


def doppler_rows(evaluation: Figures) -> list[Row]:
    """Rows that compare networks, DVL-aided dead reckoning and truth pairwise, over ground; empty
    without a Doppler log."""
    if "against_dvl" not in evaluation:
        return []
    compared = {
        "networks, from the truth": (evaluation, "dr_ground"),
        "networks, from DVL-aided": (evaluation["against_dvl"], "dr"),
        "DVL-aided, from the truth": (evaluation["baselines"]["dvl"], "dr_ground"),
    }
    return [
        {
            "track": words,
            "mean [%]": figures[f"{key}_percent_mean"],
            "median [%]": figures[f"{key}_percent_median"],
            "p90 [%]": figures[f"{key}_percent_p90"],
            "mean [m]": figures[f"{key}_m_mean"],
            "p90 [m]": figures[f"{key}_m_p90"],
        }
        for words, (figures, key) in compared.items()
    ]


def without_track(evaluation: Figures, track: str) -> str:
    """Sentences on the methods that `track_rows` leaves out; empty if there are none."""
    known = baselines()
    return " ".join(
        known[name].without_water
        for name, figures in methods_of(evaluation)
        if name in known
        and known[name].without_water
        and figures[f"dr_{track}_percent_mean"] is None
    )


def dive_rows(evaluation: Figures) -> list[Row]:
    """Rows of errors over ground between GPS fixes, with columns for each type of current."""
    rows = []
    for name, figures in methods_of(evaluation):
        row: Row = {"method": title_of(name)}
        for place, (knowledge, found) in enumerate(figures["dives"].items()):
            kind = "dr_max_percent" if knowledge == "corrected" else "dr_percent"
            row[f"{KNOWLEDGE_TITLES[knowledge]}, median [%]"] = found[f"{kind}_median"]
            row["p90 [%]" + " " * place] = found[f"{kind}_p90"]  # blanks: one key per column
        if any(value is not None for key, value in row.items() if key != "method"):
            rows.append(row)
    return rows


def summary_rows(evaluation: Figures) -> list[Row]:
    """Rows that `learn evaluate` prints, one per method."""
    return [
        {
            "method": title_of(name),
            "surge MSE [(m/s)²]": None if name == "floor" else figures["surge_mse"],
            "sway MSE [(m/s)²]": None if name == "floor" else figures["sway_mse"],
            "through water mean [%]": figures["dr_water_percent_mean"],
            "p90 [%]": figures["dr_water_percent_p90"],
            "with true attitude mean [%]": figures["dr_velocity_percent_mean"],
            "p90 [%] ": figures["dr_velocity_percent_p90"],
            "over ground mean [%]": figures["dr_ground_percent_mean"],
            "p90 [%]  ": figures["dr_ground_percent_p90"],
        }
        for name, figures in methods_of(evaluation)
    ]


def comparison_rows(evaluations: Mapping[str, Figures]) -> list[Row]:
    """Rows of several runs, followed by the first run's baselines."""
    rows: list[Row] = []
    for name, evaluation in evaluations.items():
        rows.append({"run or baseline": name} | summary_rows(evaluation)[0])
    for row in summary_rows(next(iter(evaluations.values())))[1:]:
        rows.append({"run or baseline": row["method"]} | row)
    return [{k: v for k, v in row.items() if k != "method"} for row in rows]


JUDGED = {
    "dr_water_percent_mean": "through the water",
    "dr_velocity_percent_mean": "through the water with the true attitude",
}
"""Numbers in which sentences compare networks with baselines, with their words."""
COLUMNS = {
    "surge_mse": "surge MSE",
    "sway_mse": "sway MSE",
    "dr_water_percent_mean": "through the water, mean",
    "dr_water_percent_p90": "through the water, p90",
    "dr_velocity_percent_mean": "with true attitude, mean",
    "dr_velocity_percent_p90": "with true attitude, p90",
    "dr_ground_percent_mean": "over ground, mean",
    "dr_ground_percent_p90": "over ground, p90",
}
"""Columns of `summary_rows` in which a baseline can be better, with their words."""
MOSTLY = 0.5
"""[1] Fraction of missions outside the training above which a sentence advises `learn adapt`"""
LEAST_COMPARED = 10
"""Minimum number of missions or dives for naming a better method: a median of fewer is chance."""


def verdicts(evaluation: Figures) -> list[str]:
    """Sentences on the numbers in which the networks are better or worse than the baselines."""
    sentences = []
    for key, words in JUDGED.items():
        mine = evaluation[key]
        theirs = {n: f[key] for n, f in evaluation["baselines"].items() if f[key] is not None}
        if mine is None or not theirs:
            continue
        lost = {name: value for name, value in theirs.items() if value <= mine}
        beaten = [title_of(name) for name in theirs if name not in lost]
        text = f"Dead reckoning {words}: the networks have {mine:.3g} % of the distance"
        if evaluation["missions"] < LEAST_COMPARED:
            sentences.append(
                f"{text} over {counted(evaluation['missions'], 'mission')}, too few to compare."
            )
            continue
        if beaten:
            text += f", better than {_list(beaten)}"
        if lost:
            named = _list([f"{title_of(name)} ({value:.3g} %)" for name, value in lost.items()])
            text += f"{'; they do' if beaten else ' and do'} not beat {named}"
        sentences.append(text + ".")
    if evaluation.get("best", NETWORK) != NETWORK:
        sentences.append(
            f"Navigate by {title_of(evaluation['best'])}: it has the least track error with true "
            "attitude."
        )
    before = evaluation.get("before") or {}
    if before.get("dr_velocity_percent_mean") is not None:
        sentences.append(
            "With true attitude, the networks that the training started from have "
            f"{before['dr_velocity_percent_mean']:.3g} % on these missions."
        )
    sentences += _ground_verdicts(evaluation)
    for knowledge in ("previous", "corrected"):
        sentence = _dive_verdict(evaluation, knowledge)
        if sentence:
            sentences.append(sentence)
    if (fixes := evaluation.get("fixes")) and fixes["fixes"]:
        sentences.append(
            f"Mean squared normalised innovation of a navigator on the networks, by "
            f"{counted(fixes['fixes'], 'dive')} that a fix ended: {fixes['nis']:.2f} (2: it errs "
            f"as it states); the ellipse of 50 % held {100 * fixes['in_50']:.0f} %, that of 90 % "
            f"{100 * fixes['in_90']:.0f} %."
        )
    if outside := evaluation.get("outside"):
        sentences.append(
            f"Hulls outside of the training's: {100 * outside['share']:.0f} % of the missions; "
            f"median figure {outside['median']:.2f} (above 1 is outside), by {outside['constant']}"
            + (": adapt to the vehicle, `learn adapt`." if outside["share"] > MOSTLY else ".")
        )
    if columns := _columns_lost(evaluation):
        sentences.append(f"A baseline has the lower figure in {'; '.join(columns)}.")
    return sentences


def _ground_verdicts(evaluation: Figures) -> list[str]:
    """Sentences on errors over ground without fixes."""
    floor = evaluation["floor"]
    mine, best = (f["dr_ground_percent_mean"] for f in (evaluation, floor))
    if mine is None or best is None:
        return []
    sentences = []
    if abs(best - floor["dr_water_percent_mean"]) <= STILL_PERCENT:
        sentences.append(
            f"The water stood still, so that over ground is through the water: {mine:.3g} % for "
            f"the networks, {best:.3g} % for the true surge and sway."
        )
    else:
        sentences.append(
            f"Over ground, with the current unknown and without fixes, the current decides: "
            f"{mine:.3g} % for the networks, {best:.3g} % for the true surge and sway. A steady "
            "current leaves no trace in what a vehicle feels of the water, so that no method can "
            "know it without sight of the bottom or a fix."
        )
    if rows := doppler_rows(evaluation):
        away, own = rows[1], rows[2]
        sentences.append(
            f"DVL-aided dead reckoning ends {own['mean [%]']:.3g} % from the truth over ground; "
            f"the networks end {away['mean [%]']:.3g} % from the DVL-aided track."
        )
    return sentences


def _columns_lost(evaluation: Figures) -> list[str]:
    """Columns with a better baseline that no other sentence covers, with the best baseline."""
    said = JUDGED if evaluation["missions"] >= LEAST_COMPARED else {}
    paths: dict[tuple[str, ...], str] = {
        (key,): words for key, words in COLUMNS.items() if key not in said
    }
    for knowledge, found in evaluation["dives"].items():
        kind = "dr_max_percent" if knowledge == "corrected" else "dr_percent"
        for part in ("median", "p90"):
            compared = knowledge != "none" and found["dives"] >= LEAST_COMPARED
            if part != "median" or not compared:
                paths["dives", knowledge, f"{kind}_{part}"] = (
                    f"{KNOWLEDGE_TITLES[knowledge]}, {part}"
                )
    lost = []
    for path, words in paths.items():
        mine = _figure(evaluation, path)
        theirs = {n: _figure(f, path) for n, f in evaluation["baselines"].items()}
        known = {name: value for name, value in theirs.items() if value is not None}
        if mine is None or not known:
            continue
        best = min(known, key=lambda name: known[name])
        if known[best] < mine:
            lost.append(f"{words} ({title_of(best)} {known[best]:.3g}, networks {mine:.3g})")
    return lost


def _figure(figures: Figures, path: Sequence[str]) -> float | None:
    """Number at a path of keys; None if unknown."""
    found: Any = figures
    for key in path:
        found = None if found is None else found.get(key)
    return found


def _dive_verdict(evaluation: Figures, knowledge: str) -> str:
    """Sentence on networks and baselines between fixes, without a comparison for few dives."""
    key = "dr_max_percent_median" if knowledge == "corrected" else "dr_percent_median"
    mine = evaluation["dives"][knowledge][key]
    if mine is None:
        return ""
    found = {n: f["dives"][knowledge][key] for n, f in evaluation["baselines"].items()}
    better = {n: v for n, v in found.items() if v is not None and v <= mine}
    text = (
        f"Between GPS fixes, {KNOWLEDGE_TITLES[knowledge]}: median {mine:.3g} % over "
        f"{evaluation['dives'][knowledge]['dives']} dives"
    )
    if evaluation["dives"][knowledge]["dives"] < LEAST_COMPARED:
        return text + ", too few to compare."
    if not better:
        return text + ", no baseline is better."
    return (
        text + f"; not beaten: {_list([f'{title_of(n)} ({v:.3g} %)' for n, v in better.items()])}."
    )


def _list(words: Sequence[str]) -> str:
    if len(words) < 2:
        return "".join(words)
    return ", ".join(words[:-1]) + " and " + words[-1]


def rank(figures: Figures, key: str = "dr_water_percent_mean") -> str:
    """Rank of the networks among them and the baselines by an error, such as "2 of 6"."""
    mine = figures[key]
    theirs = [one[key] for one in figures["baselines"].values() if one[key] is not None]
    if mine is None or not theirs:
        return "-"
    return f"{1 + sum(value < mine for value in theirs)} of {1 + len(theirs)}"


def judged_missions(figures: Figures) -> str:
    """Missions of an evaluation in words: how many, of which store, how many flown to judge by."""
    further, split = figures.get("further", 0), figures["split"]
    words = "mission" if split == "all" else f"{split} mission"
    text = f"{counted(figures['missions'] - further, words)} of {figures['store']}"
    return f"{text} and {further} more of its recipe" if further else text


def tell_report(console: Console, run: Run) -> None:
    """Print the numbers of an evaluated run and the path of its page."""
    figures, paper = run.figures, run.paper_figures
    assert figures is not None
    console.answer(
        **figures,
        report=run.report,
        settings=run.description["settings"],
        networks=run.description["networks"],
        label_counts=run.description.get("label_counts"),
    )
    console.table(
        summary_rows(figures),
        title=f"{judged_missions(figures)}: "
        "MSE in (m/s)², dead reckoning in % of the distance through the water",
        digits=3,
    )
    console.say()
    if paper is not None:
        console.answer(paper_test=paper)
        console.item(paper_sentence(paper))
    for sentence in (*run.label_sentences(), *verdicts(figures)):
        console.item(sentence)
    console.say()
    console.say(f"run:    {run.folder}")
    console.say(f"report: {run.report}")
