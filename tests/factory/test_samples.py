"""Samples: every kind of log has one, and an import of it gives the flight's true motion."""

import dataclasses
import tomllib

import numpy as np
import pytest
from logs import LAYOUTS, ROOT, example, refused, write

from factory import samples
from factory.importing import IMPORTERS, import_logs
from factory.samples.archives import TABLE_MAPPING
from twin.records.schema import VARIABLES

FLIGHT = samples.Flight(depth=100.0, surface=600.0)
OWN_PERIODS = {("dorado", "product"): 1.0}
"""[s] of files that were resampled"""


def test_every_kind_of_log_has_samples():
    vehicles = {kind for kind in IMPORTERS.names() if not IMPORTERS[kind].instrument}
    assert set(samples.formats()) == vehicles
    assert all(samples.formats().values())


@pytest.mark.parametrize("flight", [FLIGHT, samples.SHORT], ids=["deep", "short"])
@pytest.mark.parametrize(("kind", "layout"), LAYOUTS)
def test_an_import_gives_the_true_motion(kind, layout, flight, tmp_path):
    importer, logs = IMPORTERS[kind], tmp_path / "logs"
    paths = write(kind, layout, logs, flight)
    assert all(importer.accepts(path) for path in paths)
    dataset, report = import_logs(kind, paths, **samples.options(kind, logs, flight))
    assert report.kind == kind
    assert report.rows == flight.dives
    assert report.period == OWN_PERIODS.get((kind, layout), importer.period)
    assert set(report.channels) <= set(VARIABLES)
    for dive in range(flight.dives):
        n = int(dataset["n_samples"][dive])
        start = dataset["start_time"].values.astype(float)[dive]
        truth = flight.state(start + dataset["time"].values[:n])
        depth = dataset["measured_depth"].values[dive, :n]
        assert np.median(np.abs(depth - truth["depth"])) < 0.3
        steady = (truth["depth"] > 0.1 * flight.depth) & (truth["depth"] < 0.9 * flight.depth)
        for name in ("pitch", "heading", "pump"):
            if f"measured_{name}" in dataset:
                values = dataset[f"measured_{name}"].values[dive, :n][steady]
                limit = 2e-4 + 0.1 * flight.swing  # of the time between samples
                assert np.allclose(values, truth[name][steady], atol=limit), name
        if report.rows_with_fixes:
            moved = flight.displacement(start, start + float(dataset["dive_duration"][dive]))
            assert float(dataset["displacement_north"][dive]) == pytest.approx(moved[0], abs=3.0)
            assert float(dataset["displacement_east"][dive]) == pytest.approx(moved[1], abs=3.0)


def test_a_wrong_name_is_refused_with_the_nearest(tmp_path):
    refused("did you mean 'seaglider'", "seaglidr", tmp_path, by=samples.write)
    refused("layout of slocum.*'dbd'", "slocum", tmp_path, layout="dbf", by=samples.write)
    kind = dataclasses.replace(IMPORTERS["spray"], name="bare", samples=None)
    IMPORTERS.register("bare", kind)
    try:
        assert "bare" not in samples.formats()
        refused("bare has no samples; these have: slocum", "bare", tmp_path, by=samples.write)
    finally:
        IMPORTERS.unregister("bare")


def test_a_kind_of_ones_own_brings_its_samples(tmp_path):
    def mine(folder, flight):
        return [samples.write_csv(folder / "mine.csv", {"time": flight.time})]

    IMPORTERS.add(dataclasses.replace(IMPORTERS["spray"], name="mine", samples={"csv": mine}))
    try:
        assert samples.formats()["mine"] == ("csv",)
        (path,) = samples.write("mine", tmp_path / "made")
    finally:
        IMPORTERS.unregister("mine")
    assert len(path.read_text().splitlines()) == 1 + len(samples.SHORT.time)


def test_the_mapping_of_tables_is_that_of_the_page():
    page = (ROOT / "docs" / "howto" / "import_tables.md").read_text()
    assert tomllib.loads(TABLE_MAPPING) == tomllib.loads(example(page, "mine.toml"))
