"""Reports: pages that need nothing but themselves, tables and sentences that say what was found."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from navigation import PERIOD, add_fixes, trimmed_mission, write_store

from learn.data.dataset import MissionSequence
from learn.evaluation.deviation import ErrorModel
from learn.evaluation.evaluation import evaluate
from learn.report.card import model_card
from learn.report.contents import Contents, RunEvaluation, Showcase
from learn.report.dot_figures import distribution_figure, dive_figure
from learn.report.result_tables import (
    comparison_rows,
    dive_rows,
    summary_rows,
    track_rows,
    velocity_rows,
    verdicts,
    without_track,
)
from learn.report.run_page import build_page
from learn.report.track_figures import error_figure, track_3d_figure, track_figure, water_lines
from learn.report.velocity_figures import after_launch, uncertainty_figure, velocity_figure
from learn.run import Run
from twin.errors import InputError
from twin.show.figures.page_layout import Page


class Constant:
    """Stands for an ensemble that always says the same."""

    start = None
    spread = None

    def __init__(self, value):
        self.members = (SimpleNamespace(features=("sin_pitch",)),)
        self.value = value

    def predict(self, missions):
        return [(np.full(m.samples, self.value), np.full(m.samples, 0.01)) for m in missions]


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    missions = []
    for heading, current in ((0.3, (0.05, 0.0)), (2.0, (0.0, -0.12))):
        signals = trimmed_mission(3600, heading=heading, current=current)
        add_fixes(signals, [0, 20, 1600, 1610, 3500])
        missions.append(signals)
    store = write_store(tmp_path_factory.mktemp("report") / "s.zarr", missions, [2, 2])
    showcase = Showcase()
    networks = {"surge": Constant(0.47), "sway": Constant(0.0)}
    evaluation = evaluate(networks, store, watch=showcase.add)
    return RunEvaluation(
        evaluation=evaluation, figures=evaluation.to_json(), shown=showcase.missions
    )


@pytest.fixture(scope="module")
def page(judged, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    training = MissionSequence(
        index=0, split="train", period=PERIOD, signals=judged.shown[0].reference.mission.signals
    )
    metrics = [
        {"network": f"{target}-0", "seconds": t, "validation_mse": 1e-3 / t, "train_mse": 1e-3 / t}
        for target in ("surge", "sway")
        for t in (1.0, 2.0, 3.0)
    ]
    contents = Contents(
        title="a <run>",
        lead="two missions",
        test=judged,
        paper_test=judged,
        error_model=ErrorModel(),
        metrics=metrics,
        training=training,
        provenance={"store": "data/missions.zarr"},
        command="learn fit",
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.show.figures.page_layout.DPI", 30)
        return build_page(folder, contents)


FIGURES = {
    *("velocities", "distribution", "dives", "track", "track_3d", "errors", "uncertainty"),
    *("training_data", "learning"),
}


def test_the_page_needs_nothing_but_itself(page):
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert "http://" not in text
    assert "https://" not in text
    assert text.count('src="data:image/png;base64,') == len(FIGURES)
    assert "a &lt;run&gt;" in text


def test_every_figure_is_a_png_beside_the_page(page):
    found = {path.stem for path in page.parent.glob("*.png")}
    assert found == FIGURES
    for path in page.parent.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")


def test_every_figure_has_labelled_axes(judged):

    shown = judged.shown[0]
    drawn = [
        velocity_figure(shown),
        track_figure(shown, (), water_lines(shown, ("network", "steady_flight"))),
        error_figure(judged.shown),
        uncertainty_figure(shown, np.linspace(0.0, 10.0, len(shown.time))),
    ]
    for figure in drawn:
        texts = [axes.get_xlabel() + axes.get_ylabel() for axes in figure.axes]
        assert any("[" in text for text in texts)


def test_the_rows_of_errors_have_one_scale_and_name_their_missions(judged):

    figure = error_figure(judged.shown)
    axes = np.reshape(figure.axes, (2, 2))
    for row in axes:
        assert row[0].get_ylim() == row[1].get_ylim()
        low, high = row[0].get_ylim()
        for place in row:
            for line in place.lines[: len(judged.shown)]:
                assert low < np.min(line.get_ydata()) <= np.max(line.get_ydata()) < high
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [shown.label for shown in judged.shown]
    assert len({line.get_linewidth() for line in axes[0, 0].lines[: len(labels)]}) == 1


def test_tracks_tell_methods_apart_and_name_those_without(judged):

    methods = ("network", "pitch_plus_alpha", "steady_flight", "sextant")
    figure = track_figure(judged.shown[0], methods, water_lines(judged.shown[0], methods))
    plan, distance = figure.axes
    drawn = [line for line in plan.lines if line.get_linestyle() != "None"]
    assert len({line.get_linestyle() + str(line._dash_pattern) for line in drawn[1:]}) == 3
    assert drawn[0].get_linewidth() > 2 * drawn[1].get_linewidth()
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"truth", "start", "end", "no track: sextant"} <= set(texts)
    assert len(distance.lines) == 3
    assert "distance" in distance.get_title(loc="left")


def test_the_track_in_space_has_ends_and_a_shadow(judged):

    figure = track_3d_figure(judged.shown[0], water_lines(judged.shown[0], ("network",)))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["truth", "networks", "truth on the floor", "start", "end"]


def test_a_launch_does_not_set_the_scale_of_errors(judged):

    time = np.arange(0.0, 4000.0)
    error = np.where(time < 20.0, 500.0, np.sin(time))
    assert 0.9 < after_launch(error, time) < 1.5
    assert after_launch(np.zeros(5), np.arange(5.0)) == 1.0
    figure = velocity_figure(judged.shown[0])
    for place in figure.axes[2:]:
        low, high = place.get_ylim()
        assert low == -high
        assert any(np.allclose(line.get_ydata(), 0.0) for line in place.lines)
    assert "mission 0" in figure.get_suptitle()


def test_what_dots_and_bars_are_is_in_the_figure(judged):

    texts = [t.get_text() for t in distribution_figure(judged.evaluation).legends[0].get_texts()]
    assert texts[:2] == ["a mission", "median"]
    lacking = [n for n, f in judged.figures["baselines"].items()
               if f["dr_water_percent_mean"] is None]  # fmt: skip
    assert lacking
    assert "no track through the water" in texts[2]
    dives = [t.get_text() for t in dive_figure(judged.evaluation).legends[0].get_texts()]
    assert dives == ["a dive", "median"]


def test_dives_have_plain_numbers_and_no_empty_panel():

    def errors(*percents):
        return tuple(SimpleNamespace(percent=p, max_percent=p) for p in percents)

    dives = {"none": errors(13.0, 24.0), "previous": errors(1.8, 70.0)}
    method = SimpleNamespace(scores=[SimpleNamespace(dives=dives)])
    figure = dive_figure(SimpleNamespace(methods={"network": method}))
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "no current",
        "previous dive's current",
    ]
    figure.draw_without_rendering()
    low, high = figure.axes[0].get_xlim()
    shown = [t.get_text() for t in figure.axes[0].get_xticklabels(which="both") if t.get_text()]
    assert [t for t in shown if low <= float(t) <= high] == ["2", "5", "10", "20", "50"]


def test_the_uncertainty_says_whether_the_end_lies_inside(judged):

    shown = judged.shown[0]
    for deviation, place in ((1e6, "inside"), (0.0, "outside")):
        figure = uncertainty_figure(shown, np.full(len(shown.time), deviation))
        title = figure.axes[0].get_title(loc="left")
        assert title.startswith("mission 0, ")
        assert title.endswith(f"the end lies {place} 2 deviations")
    lines = {line.get_label(): line for line in velocity_figure(shown).axes[0].lines}
    assert lines["true"].get_zorder() > lines["predicted"].get_zorder()


def test_the_page_says_why_a_method_has_no_track_through_the_water(judged):
    without = {**judged.figures["baselines"]["steady_flight"], "dr_water_percent_mean": None}
    figures = {**judged.figures, "baselines": {"dvl": without, "onboard": without}}
    said = without_track(figures, "water")
    assert "DVL-aided method is missing" in said
    assert "in bottom lock it measures the velocity over ground" in said
    assert "on-board track is missing in them: it was reset" in said
    known = {"steady_flight": judged.figures["baselines"]["steady_flight"]}
    assert without_track({**judged.figures, "baselines": known}, "water") == ""


def test_without_dives_there_is_no_table_of_them(judged):
    without = {name: {**f, "dives": {}} for name, f in judged.figures["baselines"].items()}
    figures = {
        **judged.figures,
        "dives": {},
        "floor": {**judged.figures["floor"], "dives": {}},
        "baselines": without,
    }
    assert dive_rows(figures) == []


def test_tables_leave_out_what_a_method_does_not_define(judged):
    titles = [row["method"] for row in velocity_rows(judged.figures)]
    assert "networks" in titles
    assert "on-board track" not in titles
    assert track_rows(judged.figures, "ground")[0]["method"] == "networks"
    assert {r["method"] for r in dive_rows(judged.figures)} >= {"networks", "on-board track"}
    assert (
        summary_rows(judged.figures)[1]["surge MSE [(m/s)²]"] is None
    )  # the floor has no error to show


def test_verdicts_name_who_is_beaten_and_who_is_not(judged):
    sentences = verdicts({**judged.figures, "missions": 10})
    water = sentences[0]
    mine = judged.figures["dr_water_percent_mean"]
    for name, title in (("steady_flight", "steady flight model"), ("ekf", "EKF")):
        theirs = judged.figures["baselines"][name]["dr_water_percent_mean"]
        after = water[water.index(title) :]
        assert (f"({theirs:.3g} %)" in after[:40]) == (theirs <= mine)
    better = {**judged.figures, "missions": 10, "dr_water_percent_mean": 0.0}
    assert "not beat" not in verdicts(better)[0]
    assert "better than" in verdicts(better)[0]


def test_few_missions_and_dives_are_not_compared_and_lost_columns_are_named(judged):
    steady = judged.figures["baselines"]["steady_flight"]
    dives = {k: {**f, "dr_percent_p90": 1e-9} for k, f in steady["dives"].items()}
    baselines = {"steady_flight": {**steady, "sway_mse": -1.0, "dives": dives}}
    said = verdicts({**judged.figures, "sway_mse": 1.0, "baselines": baselines})
    assert "over 2 missions, too few to compare." in said[0]
    previous = next(s for s in said if "previous dive's current: median" in s)
    assert previous.endswith("dives, too few to compare.")
    assert not any("no baseline is better" in s or "better than" in s for s in said)
    assert "sway MSE (steady flight model -1, networks 1)" in said[-1]
    assert "no current, p90 (steady flight model 1e-09" in said[-1]
    known = judged.figures["dives"]["previous"] | {"dives": 10, "dr_percent_median": 0.0}
    many = {**judged.figures, "dives": {**judged.figures["dives"], "previous": known}}
    assert any("over 10 dives, no baseline is better" in s for s in verdicts(many))


def test_comparison_puts_runs_first_and_baselines_once(judged):
    rows = comparison_rows({"a": judged.figures, "b": judged.figures})
    names = [row["run or baseline"] for row in rows]
    assert names[:2] == ["a", "b"]
    assert len(names) == len(set(names))


def test_the_model_card_has_its_head_and_says_what_it_is_not(judged, tmp_path):
    settings = {
        "store": "data/missions.zarr",
        "features": ["sin_pitch"],
        "members": 2,
        "division": "samples",
        "network": {"kind": "elman", "layers": 3, "hidden": 50, "delays": 5},
        "training": {"optimiser": "scg", "seed": 1},
    }
    run = Run(tmp_path / "mine", {"settings": settings, "store": {"preset": "paper"}})
    card = model_card(run, judged.figures, "test")
    assert card.startswith("---\n")
    assert "leaks" in card
    assert "do not know the current" in card
    assert "| networks |" in card
    assert "simulated missions (preset paper)" in card
    assert "trained on samples of what they are judged on" not in card
    assert "trained on samples of what they are judged on" in model_card(run, judged.figures, "all")


def test_the_model_card_shows_what_stores_say_as_text(judged, tmp_path):
    hostile = "x|y <script>alert(1)</script>\n# `no` [head](http://x)"
    settings = {
        "store": hostile,
        "features": [hostile],
        "members": 2,
        "division": "missions",
        "network": {"kind": "elman", "layers": 3, "hidden": 50, "delays": 5},
        "training": {"optimiser": "scg", "seed": hostile},
    }
    run = Run(tmp_path / "a\n```\n<b>", {"settings": settings, "store": {"preset": hostile}})
    card = model_card(run, judged.figures, "test")
    outside = "".join(card.split("\n```")[::2])
    assert "<script>" not in card
    assert "<b>" not in outside
    assert "\n# `no`" not in card
    assert "](http" not in card.replace(r"\](http", "")
    assert card.count("\n```\n") == 2
    assert r"x\|y &lt;script&gt;alert(1)&lt;/script&gt; # \`no\` \[head\](http://x)" in card


def test_showcase_keeps_the_longest(judged):
    showcase = Showcase(most=1)
    for shown in judged.shown:
        showcase.add(shown.reference, shown.estimates)
    assert len(showcase.missions) == 1


def test_a_page_into_an_impossible_folder_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file, not a folder"):
        Page(tmp_path / "file" / "page", "t", "l")


def test_a_page_replaces_a_page_and_nothing_else(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("precious")
    with pytest.raises(InputError, match="glider-twin did not write it"):
        Page(tmp_path / "mine", "t", "l")
    for title in ("one", "two"):
        page = Page(tmp_path / "page", title, "l")
        page.figure(title, Figure(figsize=(1, 1)), "a figure")
        assert not (tmp_path / "page" / f"{title}.png").exists()
        page.write()
    names = sorted(path.name for path in (tmp_path / "page").iterdir())
    assert names == ["checksums.json", "index.html", "two.png"]


def test_pages_escape_what_they_are_given(tmp_path):
    page = Page(tmp_path, "t", "l")
    page.table([{"<b>": "<script>"}])
    page.facts({"a": "<i>"})
    page.figure("f", Figure(figsize=(1, 1)), '"quoted"')
    text = page.write().read_text()
    assert "<script>" not in text
    assert "<i>" not in text
    assert 'alt="&#34;quoted&#34;"' in text
