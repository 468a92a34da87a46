"""The data set for an ERDDAP server: by the rules of its administrators' manual, and read back."""

import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import netCDF4
import numpy as np
import pytest
from erddap_server import Erddap
from logs import example, refused, stored

from factory.__main__ import PROGRAM
from factory.exporting import EXPORTERS, ExportOptions
from factory.generation.generated_store import open_missions
from factory.samples import Flight
from factory.samples.gliders import write_basestation
from glider_twin_ops.watching.sources import fetch_days
from twin.records.logged import LogStore

FLIGHT = Flight(dives=3)
KINDS = {
    "byte": np.int8, "short": np.int16, "int": np.int32, "long": np.int64, "float": np.float32,
    "double": np.float64, "String": str,
}  # fmt: skip
"""ERDDAP's data types that these files could have"""
CATEGORIES = {
    "Bathymetry", "Biology", "Colored Dissolved Organic Matter", "Currents", "Dissolved O2",
    "Identifier", "Location", "Ocean Color", "Optical Properties", "Other", "Pressure", "Quality",
    "Salinity", "Temperature", "Time",
}  # fmt: skip
"""Of those that ERDDAP takes, the ones that a glider can have"""
TAGS = (
    "reloadEveryNMinutes", "fileDir", "fileNameRegex", "recursive", "accessibleViaFiles",
    "metadataFrom", "addAttributes",
)  # fmt: skip
"""Of a data set, in the order of the manual's skeleton"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    return stored(folder / "real.zarr", "seaglider", write_basestation(folder, FLIGHT), period=4.0)


@pytest.fixture(scope="module")
def served(store, tmp_path_factory):
    folder = tmp_path_factory.mktemp("served") / "calypso"
    EXPORTERS["erddap"].export(LogStore(store), range(FLIGHT.dives), folder)
    return folder


def attributes(tag):
    """What `addAttributes` adds; ERDDAP takes letters, digits and underscores as names."""
    (added,) = tag.findall("addAttributes")
    names = [str(one.get("name")) for one in added]
    assert len(set(names)) == len(names)
    for name in names:
        assert re.fullmatch(r"_?[A-Za-z][A-Za-z0-9_]*", name), name
    return {str(one.get("name")): str(one.text) for one in added}


def check_data_set(tag, folder):
    """The manual's demands on an EDDTableFromMultidimNcFiles of trajectories."""
    assert tag.tag == "dataset"
    assert tag.get("type") == "EDDTableFromMultidimNcFiles"
    assert tag.get("active") == "true"
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", str(tag.get("datasetID")))
    order = [one.tag for one in tag if one.tag != "dataVariable"]
    assert tuple(order) == TAGS
    assert Path(str(tag.findtext("fileDir"))) == folder
    pattern = str(tag.findtext("fileNameRegex"))
    files = [path for path in folder.iterdir() if re.fullmatch(pattern, path.name)]
    assert files
    said = attributes(tag)
    variables = tag.findall("dataVariable")
    names = [str(one.findtext("destinationName")) for one in variables]
    assert len(set(names)) == len(names)
    assert {"time", "latitude", "longitude", "depth"} <= set(names)
    once = said["cdm_trajectory_variables"].split(",")
    assert said["subsetVariables"].split(",") == once
    assert not set(once) & {"time", "latitude", "longitude", "depth"}
    for path in files:
        with netCDF4.Dataset(path) as file:
            combined = {**file.__dict__, **said}
            for name in ("cdm_data_type", "infoUrl", "institution", "summary", "title"):
                assert str(combined[name]) not in ("", "null"), name
            assert combined["cdm_data_type"] == "Trajectory"
            assert str(combined["featureType"]).lower() == "trajectory"
            assert [str(one.findtext("sourceName")) for one in variables] == list(file.variables)
            roles = []
            for one in variables:
                source = file[str(one.findtext("sourceName"))]
                destination = str(one.findtext("destinationName"))
                assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", destination)
                assert source.dtype == KINDS[str(one.findtext("dataType"))]
                assert (destination in once) == (source.dimensions == ())
                own = {**source.__dict__, **attributes(one)}
                assert own["ioos_category"] in CATEGORIES
                assert own.get("coordinates", "null") == "null"
                if source.dtype in (np.int8, np.int32):
                    assert "_FillValue" in own, destination
                if destination in {"time", "depth", "latitude", "longitude"}:
                    assert own["standard_name"] == destination
                if own.get("cf_role") == "trajectory_id":
                    roles.append(destination)
            assert file["DEPTH"].units == "m"
            assert file["DEPTH"].positive == "down"
            assert file["TIME"].units.startswith("seconds since 1970-01-01")
            assert roles == ["TRAJECTORY"]
            assert roles[0] in once


def test_a_deployment_is_a_data_set_by_the_manual(served):
    root = ElementTree.parse(served / "datasets.xml").getroot()
    assert root.tag == "erddapDatasets"
    (tag,) = root
    check_data_set(tag, served)


def test_categories_are_those_of_what_was_measured(served):
    (tag,) = ElementTree.parse(served / "datasets.xml").getroot()
    found = {
        str(one.findtext("destinationName")): attributes(one)["ioos_category"]
        for one in tag.findall("dataVariable")
    }
    expected = {
        "time": "Time", "TIME_GPS": "Time", "latitude": "Location", "depth": "Location",
        "PRES": "Pressure", "PRES_QC": "Quality", "TEMP": "Temperature", "PSAL": "Salinity",
        "CNDC": "Salinity", "DAC_NORTH": "Currents", "VERT_CURR_MODEL": "Currents",
        "TRAJECTORY": "Identifier", "PITCH": "Other",
    }  # fmt: skip
    assert {name: found[name] for name in expected} == expected


def test_simulated_missions_are_one_data_set(field_store, tmp_path):
    EXPORTERS["erddap"].export(open_missions(field_store), [0, 1], tmp_path / "served")
    (tag,) = ElementTree.parse(tmp_path / "served" / "datasets.xml").getroot()
    check_data_set(tag, tmp_path / "served")
    assert tag.get("datasetID") == "missions"
    assert len(list((tmp_path / "served").glob("*.nc"))) == 2
    assert attributes(tag)["id"] == "null"


def test_the_command_takes_the_server_s_folder(store, tmp_path):
    out = tmp_path / "1 & 2"
    words = ["export", str(store), "--to", "erddap", "--out", str(out)]
    assert PROGRAM.main([*words, "--file-dir", "/data/a & b"]) == 0
    (tag,) = ElementTree.parse(out / "datasets.xml").getroot()
    assert tag.findtext("fileDir") == "/data/a & b"
    refused(
        "the parquet export takes no --file-dir: leave it out",
        open_missions(store),
        [0],
        tmp_path / "a.parquet",
        options=ExportOptions(file_dir="/a"),
        by=EXPORTERS["parquet"].export,
    )


@pytest.mark.parametrize("folder", ["data", "", "/data/\x01"])
def test_a_folder_that_no_server_finds_is_refused(store, tmp_path, folder):
    refused(
        r"must be the absolute path .* such as /data/calypso",
        LogStore(store),
        [0],
        tmp_path / "served",
        options=ExportOptions(file_dir=folder),
        by=EXPORTERS["erddap"].export,
    )


def test_a_page_about_it_is_an_address(store, tmp_path):
    metadata, out = tmp_path / "deployment.yml", tmp_path / "served"
    metadata.write_text(
        "metadata:\n  references: 'Doe, J. (2026): Gliding'\n  creator_url: www.a.example/b\n"
    )
    EXPORTERS["erddap"].export(LogStore(store), [0], out, options=ExportOptions(metadata=metadata))
    (tag,) = ElementTree.parse(out / "datasets.xml").getroot()
    assert attributes(tag)["infoUrl"] == "https://www.a.example/b"


MAPPING = example(
    (Path(__file__).parents[3] / "docs" / "howto" / "erddap.md").read_text(), "served.toml"
)
"""Of the page: what the server shows, by its names and units"""
MAPPED = tomllib.loads(MAPPING)["signals"]


def table(served):
    """What a server makes of the folder: datasetID, header and rows."""
    (tag,) = ElementTree.parse(served / "datasets.xml").getroot()
    (path,) = served.glob("*.nc")
    header, columns = [], []
    with netCDF4.Dataset(path) as file:
        for one in tag.findall("dataVariable"):
            source, name = file[str(one.findtext("sourceName"))], one.findtext("destinationName")
            own = {**source.__dict__, **attributes(one)}
            timed = str(own.get("units", "")).startswith("seconds since 1970-01-01")
            assert own.get("time_precision") == ("1970-01-01T00:00:00.000Z" if timed else None)
            units = "UTC" if timed else own.get("units")
            header.append(f"{name} ({units})" if units else str(name))
            values = np.ma.asarray(source[...])
            if values.dtype.kind in "if":
                values = np.ma.filled(values.astype(object), np.nan)
            columns.append(np.broadcast_to(values, file.dimensions["N_MEASUREMENTS"].size))
    return str(tag.get("datasetID")), header, np.stack(columns, axis=1)


def test_what_a_server_shows_of_it_is_the_log(store, served, tmp_path):
    pytest.importorskip("erddapy", reason="the extra erddap is not installed")
    name, header, rows = table(served)
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(MAPPING)
    with Erddap(name, header, rows).serving() as server:
        fetch_days(server.address, tmp_path)
    files = sorted(tmp_path.glob("*.csv"))
    assert files
    again = stored(tmp_path / "back.zarr", "csv", files, period=4.0, mapping=mapping)
    back, first = LogStore(again), LogStore(store)
    assert len(back) == len(first) == FLIGHT.dives
    for dive in range(FLIGHT.dives):
        np.testing.assert_allclose(back.time(dive), first.time(dive), rtol=0, atol=1e-3)
        gap = back.signal("measured_gap", dive) != first.signal("measured_gap", dive)
        assert np.count_nonzero(gap) <= 2  # the samples at both rims of what was never measured
        for signal in [one for one in MAPPED if one.startswith("measured_")]:
            np.testing.assert_allclose(
                back.signal(signal, dive), first.signal(signal, dive), rtol=0, atol=1e-3,
                err_msg=f"{signal} of dive {dive}",
            )  # fmt: skip
        np.testing.assert_allclose(back.fixes(dive), first.fixes(dive), rtol=0, atol=1e-6)
