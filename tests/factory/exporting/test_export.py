"""Exports: OG1.0 files that the compliance checker passes, a Parquet table, a page of plots."""

import importlib.util
import sys

import netCDF4
import numpy as np
import pytest
from compliance import complaints, needs_checker
from logs import refused

from factory.exporting import EXPORTERS
from factory.exporting.flat_table import export_parquet
from factory.exporting.og1.missions import export_og1, phases
from factory.exporting.og1.og1_terms import TERMS, sensor_attributes
from factory.generation.generated_store import GeneratedStore
from factory.missions_page import store_page
from twin.errors import StoreError
from twin.records.schema import VARIABLES
from twin.sensors import SensorSuite


@pytest.fixture(scope="module")
def og1(field_store, tmp_path_factory):
    return export_og1(GeneratedStore(field_store), 1, tmp_path_factory.mktemp("og1"))


def test_og1_has_what_the_format_demands_and_says_that_it_is_simulated(og1, field_store):
    run = GeneratedStore(field_store)
    samples = int(run.samples[1])
    with netCDF4.Dataset(og1) as file:
        for name in ("title", "platform", "platform_vocabulary", "id", "contributor_name",
                     "contributor_email", "contributor_role", "contributor_role_vocabulary",
                     "contributing_institutions", "rtqc_method", "start_date", "date_created",
                     "featureType", "Conventions"):  # fmt: skip
            assert file.getncattr(name), name
        assert file.featureType == "trajectory"
        assert "OG-1.0" in file.Conventions
        assert og1.name == f"{file.id}.nc"
        assert "SIMULATED" in file.title
        assert "SIMULATED" in file.comment
        for name in ("TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS",
                     "LONGITUDE_GPS", "PHASE"):  # fmt: skip
            assert file[name].dimensions == ("N_MEASUREMENTS",), name
            assert len(file[name]) == samples
        for name in ("TRAJECTORY", "WMO_IDENTIFIER", "PLATFORM_MODEL", "PLATFORM_SERIAL_NUMBER",
                     "DEPLOYMENT_TIME", "DEPLOYMENT_LATITUDE", "DEPLOYMENT_LONGITUDE"):  # fmt: skip
            assert file[name].dimensions == (), name
        assert file["TRAJECTORY"].cf_role == "trajectory_id"
        assert file["PHASE"].phase_vocabulary == TERMS["variables"]["PHASE"]["phase_vocabulary"]
        np.testing.assert_allclose(np.diff(file["TIME"][:]), 0.5)
        assert file.dimensions["N_MEASUREMENTS"].isunlimited()
        for name in ("TIME", "TIME_GPS"):
            assert file[name].get_fill_value() == -1.0
        latitude, depth = np.asarray(file["LATITUDE"][:]), np.asarray(file["DEPTH"][:])
        assert (file.geospatial_lat_min, file.geospatial_lat_max) == (
            latitude.min(),
            latitude.max(),
        )
        assert (file.geospatial_vertical_min, file.geospatial_vertical_max) == (
            depth.min(),
            depth.max(),
        )
        pitch = run.row("measured_pitch", 1)[:samples]
        np.testing.assert_array_equal(np.asarray(file["PITCH"][:]), pitch)
        gps = np.ma.getmaskarray(file["LATITUDE_GPS"][:])
        np.testing.assert_array_equal(~gps, np.isfinite(run.row("measured_gps_north", 1)[:samples]))
        np.testing.assert_array_equal(gps, np.ma.getmaskarray(file["TIME_GPS"][:]))


@needs_checker
@pytest.mark.filterwarnings("ignore:Passing the dataset:DeprecationWarning")
def test_og1_passes_the_cf_check(og1, tmp_path, monkeypatch):
    found = complaints(og1, ["cf:1.10"], tmp_path, monkeypatch)
    assert not any(found["cf:1.10"].values()), found


def test_og1_says_what_the_codes_mean_and_the_dvl_refers_to(og1, field_store):
    """A velocity over the bottom contains the current, one through the water does not."""
    run = GeneratedStore(field_store)
    with netCDF4.Dataset(og1) as file:
        for name in ("PHASE", "DVL_MODE"):
            meanings = str(file[name].flag_meanings).split()
            assert len(meanings) == len(file[name].flag_values)
            assert set(np.unique(file[name][:])) <= set(file[name].flag_values)
        mode = np.asarray(file["DVL_MODE"][:])
        np.testing.assert_array_equal(mode, run.row("measured_dvl_mode", 1)[: len(mode)])
        np.testing.assert_array_equal(mode == 0, np.isnan(np.asarray(file["DVL_SURGE"][:])))
        for stored in file.variables.values():
            if sensor := getattr(stored, "sensor", None):
                assert sensor in file.variables


def test_og1_names_what_the_ctd_measured(og1, field_store, paper_store):
    """As OceanGliders names it; water of density alone has none of it, nor the instrument."""
    run = GeneratedStore(field_store)
    with netCDF4.Dataset(og1) as file:
        for term, stored, standard in (
            ("TEMP", "measured_temperature", "sea_water_temperature"),
            ("PSAL", "measured_salinity", "sea_water_practical_salinity"),
        ):
            assert (file[term].standard_name, file[term].sensor) == (standard, "SENSOR_CTD")
            samples = len(file[term])
            np.testing.assert_array_equal(file[term][:], run.row(stored, 1)[:samples])
        assert "Sea-Bird Glider Payload CTD" in file["SENSOR_CTD"].sensor_model
    bare = export_og1(GeneratedStore(paper_store), 0, og1.parent / "paper")
    with netCDF4.Dataset(bare) as file:
        assert not {"TEMP", "PSAL", "SENSOR_CTD"} & set(file.variables)


@pytest.mark.parametrize(
    ("sensors", "ahrs", "dvl"),
    [
        ("ideal", "simulated ideal attitude and heading reference", "simulated ideal Doppler"),
        ("field", "simulated Microstrain 3DM-GX5-25", "simulated LinkQuest"),
        ("field-no-dvl", "simulated Microstrain 3DM-GX5-25", "none: this vehicle has no Doppler"),
    ],
)
def test_og1_calls_the_sensors_what_they_were(sensors, ahrs, dvl, field_store, monkeypatch):
    run = GeneratedStore(field_store)
    monkeypatch.setattr(run, "suite", SensorSuite.preset(sensors))
    for name, model in (("SENSOR_AHRS", ahrs), ("SENSOR_DVL", dvl)):
        attributes = sensor_attributes(run, name)
        assert attributes["sensor_model"] == attributes["long_name"]
        assert attributes["sensor_model"].startswith(model)


def test_phases_are_those_of_the_vocabulary():
    depth = np.array([0.2, 50.0, 50.0, 120.0])
    down = np.array([0.0, 0.2, -0.2, 0.01])
    np.testing.assert_array_equal(phases(depth, down), [3, 2, 1, 5])


def test_a_signal_that_the_format_needs_and_the_store_lacks_is_named(field_store, tmp_path):
    run = GeneratedStore(field_store)
    run.dataset = run.dataset.drop_vars(["measured_depth", "measured_dvl_mode"])
    with pytest.raises(StoreError, match=r"lacks measured_depth, measured_dvl_mode: OG1\.0 needs"):
        export_og1(run, 1, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="pyarrow is not installed")
def test_parquet_has_a_row_for_every_sample(field_store, tmp_path):
    import pyarrow.parquet as pq

    run = GeneratedStore(field_store)
    (path,) = export_parquet(run, range(len(run)), tmp_path / "missions.parquet", lambda: None)
    table = pq.read_table(path)
    assert table.num_rows == run.samples.sum()
    stored = [name for name in VARIABLES if name in run.dataset]
    assert len(stored) > 50
    where = ["datetime", "latitude", "longitude"]
    assert table.column_names == ["mission", "split", "time", *where, *stored]
    assert table.schema.field("true_surge").metadata[b"units"] == b"m s-1"
    mission = table["mission"].to_numpy()
    depth = table["true_depth"].to_numpy()[mission == 1]
    np.testing.assert_array_equal(depth, run.row("true_depth", 1)[: len(depth)])
    splits = dict(zip(mission.tolist(), table["split"].to_pylist(), strict=True))
    assert list(splits.values()) == run.splits


def test_without_pyarrow_the_way_out_is_told(field_store, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    refused(
        r"needs the package pyarrow.*glider-twin\[parquet\]",
        GeneratedStore(field_store),
        [0],
        tmp_path / "missions.parquet",
        lambda: None,
        by=EXPORTERS["parquet"].export,
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "panels"), [("paper_store", 12), ("field_store", 15)])
def test_the_page_has_every_panel_with_data(name, panels, request, tmp_path):
    run = GeneratedStore(request.getfixturevalue(name))
    figure = store_page(run)
    assert len(figure.axes) == panels
    assert all(axes.has_data() for axes in figure.axes)
    assert f"{len(run)} missions" in figure.get_suptitle()
    figure.savefig(tmp_path / "page.png", dpi=40)
    assert (tmp_path / "page.png").stat().st_size > 10_000
