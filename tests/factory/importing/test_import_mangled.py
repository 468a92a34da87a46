"""Logs as real life mangles them: each comes in whole, or one line says what is wrong."""

import gc
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from logs import refused, write

from factory import samples
from factory.importing import import_logs
from factory.samples import Flight
from factory.samples.archives import write_og1, write_table
from factory.samples.gliders import write_basestation, write_seaglider
from glider_twin_protocols.auv_samples import write_mat
from twin.errors import InputError

FLIGHT = Flight(dives=2)


@pytest.mark.parametrize(
    "mangle",
    [
        lambda content: content.decode().encode("utf-16"),
        lambda content: b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"),
        lambda content: content + content,
        lambda content: content.replace(b",", b";").replace(b".", b","),
        lambda content: content[: len(content) - 7],
        lambda content: content.replace(b"\n", b"\n\n"),
    ],
    ids=["utf-16", "bom and crlf", "its header again", "decimal commas", "cut", "empty lines"],
)
def test_tables_of_other_programs_come_in_whole(mangle, tmp_path):
    (table,) = write_table(tmp_path, FLIGHT)
    table.write_bytes(mangle(table.read_bytes()))
    _, report = import_logs("csv", [table], mapping=tmp_path / "mine.toml")
    assert report.rows == FLIGHT.dives


def test_a_table_without_a_value_is_refused_in_one_line(tmp_path):
    (table,) = write_table(tmp_path, FLIGHT)
    header, *rows = table.read_text().splitlines()
    bare = [",".join([row.split(",")[0], *["nan"] * header.count(",")]) for row in rows]
    table.write_text("\n".join([header, *bare]))
    refused(r"^log\.csv: no signal has a value$", "csv", [table], mapping=tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("kind", "write"),
    [
        ("og1", lambda folder: [write_og1(folder / "a.nc", FLIGHT)]),
        ("lrauv", lambda folder: [write_mat(folder / "a.mat", FLIGHT)]),
        ("seaglider", lambda folder: write_basestation(folder, FLIGHT)),
    ],
)
def test_copies_in_another_folder_are_read_once(kind, write, tmp_path):
    files = write(tmp_path)
    (tmp_path / "backup").mkdir()
    copies = [Path(shutil.copy(path, tmp_path / "backup" / path.name)) for path in files]
    _, report = import_logs(kind, [*files, *copies])
    assert report.rows == FLIGHT.dives
    assert report.count("left out", "files") == len(copies)


def test_a_spoilt_row_of_a_table_of_dives_is_left_out(tmp_path):
    write_seaglider(tmp_path, FLIGHT)
    (dives,) = tmp_path.glob("*_dives.csv")
    lines = dives.read_text().splitlines()
    dives.write_text("\n".join([*lines, lines[-1].replace("SG999", "S?999")]))
    _, report = import_logs("seaglider", sorted(tmp_path.glob("*.csv")))
    assert report.rows == FLIGHT.dives
    assert report.count("left out", "S?999") == 1


def test_a_failed_import_names_what_could_not_be_read(tmp_path):
    write_seaglider(tmp_path, FLIGHT)
    (dives,) = tmp_path.glob("*_dives.csv")
    dives.write_text("")
    refused(
        r"magnetic.*left out before: .*_dives\.csv is empty",
        "seaglider",
        sorted(tmp_path.glob("*.csv")),
    )


def test_what_is_wrong_with_the_only_file_is_said_once(tmp_path):
    (tmp_path / "zero.dbd").touch()
    refused(r"^\S*zero\.dbd is empty$", "slocum", [tmp_path / "zero.dbd"])


@pytest.mark.parametrize("kind", ["csv", "slocum", "lrauv", "seaglider"])
def test_a_web_page_and_a_store_are_called_what_they_are(kind, tmp_path):
    page = tmp_path / "log.csv"
    page.write_text("\n<!DOCTYPE html><html><body>please log in</body></html>")
    refused(r"log.csv is a web page \(HTML\) and no log", kind, [page])
    store = tmp_path / "real.zarr"
    store.mkdir()
    (store / "zarr.json").write_text("{}")
    refused("is a store already; name the logs", kind, [store])


SCALED = {
    ("og1", "netcdf"): "PITCH", ("ngdac", "profiles"): "depth", ("spray", "binned"): "lat",
    ("lrauv", "nc4"): "depth", ("seaglider", "basestation"): "pressure",
    ("dorado", "netcdf"): "mDepth",
}  # fmt: skip
"""A variable that each kind reads from netCDF"""


@pytest.mark.parametrize(("kind", "layout"), SCALED)
@pytest.mark.parametrize("scale", ["down", [1.0, 2.0]], ids=["text", "two numbers"])
def test_a_scale_that_is_no_number_is_named(kind, layout, scale, tmp_path):
    for path in write(kind, layout, tmp_path, FLIGHT):
        with netCDF4.Dataset(path, "a") as file:
            if SCALED[kind, layout] in file.variables:
                file[SCALED[kind, layout]].scale_factor = scale
    refused(
        rf"damaged: scale_factor of {SCALED[kind, layout]} is",
        kind,
        [tmp_path],
        keep_going=False,
        **samples.options(kind, tmp_path),
    )


@pytest.mark.parametrize(("kind", "layout"), SCALED)
def test_limits_of_another_type_are_no_warning(kind, layout, tmp_path):
    """What they would have been for is read all the same."""
    for path in write(kind, layout, tmp_path, FLIGHT):
        with netCDF4.Dataset(path, "a") as file:
            for name in file.variables:
                file[name].setncattr_string("valid_range", "low to high")
    _, report = import_logs(kind, [tmp_path], **samples.options(kind, tmp_path))
    assert report.rows == FLIGHT.dives


def test_numbers_beyond_any_measurement_are_removed_and_counted(tmp_path):
    path = write_og1(tmp_path / "a.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file["PITCH"][40:43] = [1e308, -1e308, 1e36]
        file["TIME"][50] = 1e308
    dataset, report = import_logs("og1", [path], variation_deg=0.0)
    assert report.count("removed", "PITCH") == 3
    assert np.nanmax(np.abs(dataset["measured_pitch"])) < 27.0
    (table,) = write_table(tmp_path, FLIGHT)
    header, first, *rows = table.read_text().splitlines()
    column = header.split(",").index("theta")
    cells = rows[40].split(",")
    rows[40] = ",".join([*cells[:column], "1e308", *cells[column + 1 :]])
    table.write_text("\n".join([header, first, *rows]))
    _, report = import_logs("csv", [table], mapping=tmp_path / "mine.toml")
    assert report.count("removed", "theta") == 1


def test_positions_that_are_not_on_earth_begin_no_dive(tmp_path):
    """Whatever the kind: here columns of a table, which no reader turns into degrees."""
    (table,) = write_table(tmp_path, FLIGHT)
    header, *rows = table.read_text().splitlines()
    column = header.split(",").index("lat")
    cells = [row.split(",") for row in rows]
    fixes = [row for row in cells if row[column]]
    for row in fixes[:3]:
        row[column] = repr(1000.0 * float(row[column]))
    table.write_text("\n".join([header, *(",".join(row) for row in cells)]))
    dataset, report = import_logs("csv", [table], mapping=tmp_path / "mine.toml")
    assert report.rows == FLIGHT.dives
    (told,) = [e for e in report.entries if e.detail == "no position on Earth"]
    assert (told.action, told.subject, told.count) == ("removed", "GPS fixes", 3)
    assert np.nanmax(np.abs(dataset["start_latitude"])) <= 90.0


def test_a_damaged_dataflash_log_is_read_in_silence_and_closed(tmp_path, capfd):
    pytest.importorskip("pymavlink")
    (path,) = samples.write("ardusub", tmp_path, FLIGHT)
    whole = path.read_bytes()
    at = whole.index(b"\xa3\x95", len(whole) // 2)
    path.write_bytes(whole[:at] + bytes(700) + whole[at:])
    _, report = import_logs("ardusub", [path], mapping=tmp_path / "mine.toml")
    assert report.rows == FLIGHT.dives
    path.write_bytes(bytes(700) + whole[700:])  # its formats are gone
    with pytest.raises(InputError):
        import_logs("ardusub", [path], mapping=tmp_path / "mine.toml")
    gc.collect()  # a file that is still open would be a warning, and so an error, here
    assert capfd.readouterr() == ("", "")


def test_a_topic_without_times_is_left_out(tmp_path):
    paths = write("dorado", "netcdf", tmp_path, FLIGHT)
    (gps,) = [path for path in paths if path.name == "gps.nc"]
    with netCDF4.Dataset(gps, "a") as file:
        file["time"][:] = np.nan
    _, report = import_logs("dorado", [tmp_path], mapping=tmp_path / "mine.toml")
    assert report.rows == FLIGHT.dives
    assert "gps has no time in any message" in [e.detail for e in report.entries]


def test_rows_of_a_glider_with_an_endless_name_are_left_out(tmp_path):
    write_seaglider(tmp_path, FLIGHT)
    (dives,) = tmp_path.glob("*_dives.csv")
    lines = dives.read_text().splitlines()
    dives.write_text("\n".join([*lines, lines[-1].replace("SG999", "S" * 300)]))
    _, report = import_logs("seaglider", sorted(tmp_path.glob("*.csv")))
    assert report.rows == FLIGHT.dives
    assert report.count("left out", dives.name) == 1
    assert max(map(len, report.deployments)) < 10


def test_a_spray_s_variable_of_another_length_is_named(tmp_path):
    (path,) = write("spray", "binned", tmp_path, FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file.renameVariable("lat_uv", "was")
        file.createDimension("short", 1)
        file.createVariable("lat_uv", "f8", ("short",))[:] = 50.0
    refused(r"lat_uv has 1 values, time 2: one belongs to each", "spray", [path])
