"""Objects in notebooks: well-formed, with what they are and a picture that shows it."""

from xml.etree import ElementTree

import numpy as np
import pytest

import twin
from twin.identify.answer import Identification, IdentifiedParameter
from twin.notebook import card, line, spans
from twin.records.reader import MissionStore


def seen(shown: object) -> tuple[dict[str, str], ElementTree.Element]:
    """Rows of the table, and the whole."""
    tree = ElementTree.fromstring(shown._repr_html_() if hasattr(shown, "_repr_html_") else shown)
    rows = {row[0].text or "": row[1].text or "" for row in tree.iter("tr")}
    return rows, tree


def points(tree: ElementTree.Element) -> np.ndarray:
    (drawn,) = tree.iter("polyline")
    return np.array([[float(x) for x in one.split(",")] for one in drawn.get("points", "").split()])


@pytest.fixture(scope="module")
def trajectory():
    return twin.simulate(duration=1200.0)


def test_a_run_shows_its_dive(trajectory):
    rows, tree = seen(trajectory)
    assert (rows["vehicle"], rows["duration"]) == ("glider", "1200 s")
    drawn, depth = points(tree), trajectory["true_depth"]
    deepest = drawn[np.argmax(drawn[:, 1]), 0]  # pixels count downwards, as depth does
    share = (deepest - drawn[0, 0]) / (drawn[-1, 0] - drawn[0, 0])
    assert share == pytest.approx(np.argmax(depth) / (len(depth) - 1), abs=0.02)
    assert len(drawn) <= 200


def test_a_store_shows_its_first_mission(trajectory, tmp_path):
    trajectory.save(tmp_path / "run.zarr")
    with MissionStore(tmp_path / "run.zarr") as store:
        rows, tree = seen(store)
    assert (rows["missions"], rows["kind"], rows["period"]) == ("1", "simulated", "0.5 s")
    assert points(tree)[:, 1].max() > 80.0


@pytest.mark.parametrize("name", ["glider", "tethys"])
def test_a_vehicle_shows_its_hull_and_parts(name):
    vehicle = twin.load_vehicle(name)
    rows, tree = seen(vehicle)
    assert rows["mass"] == f"{vehicle.mass:.4g} kg"
    (ellipse,) = tree.iter("ellipse")
    shape = float(ellipse.get("rx", "")) / float(ellipse.get("ry", ""))
    assert shape == pytest.approx(vehicle.hull_length / vehicle.hull_diameter, rel=0.02)
    assert [dot[0].text for dot in tree.iter("circle")] == list(vehicle.part_names)


def test_an_identification_shows_what_moved():
    def estimate(name: str, value: float, determined: bool) -> IdentifiedParameter:
        return IdentifiedParameter(
            name=name, unit="1", meaning="", nominal=1.0, value=value, deviation=0.1, spread=0.5,
            determined=determined, note="",
        )  # fmt: skip

    found = object.__new__(Identification)
    object.__setattr__(
        found, "estimates", (estimate("drag", 1.5, True), estimate("lift", 1.0, False))
    )
    for name, value in (("model", "flight"), ("depth_rate_rmse", 0.012), ("missions", 6)):
        object.__setattr__(found, name, value)
    rows, tree = seen(found)
    assert rows["drag"].startswith("1.5 +- 0.1")
    assert rows["lift"].endswith("(nominal stands)")
    (dot,) = tree.iter("circle")
    assert float(dot.get("cx", "")) > 200.0  # a spread above nominal, the farthest


def test_names_of_others_are_text_and_holes_are_left_out():
    rows, _ = seen(card("<b>", {"<script>": "a & b"}))
    assert rows == {"<script>": "a & b"}
    assert line([0.0, 1.0], [np.nan, 1.0], "x") == ""
    assert spans([], "x") == ""
