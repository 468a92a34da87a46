"""Memory of an import: small files, made to fill it, take less than 1 GB."""

import gzip
import json
import struct
import subprocess
import sys

import netCDF4
import numpy as np
import pytest
from logs import pack, refused

from factory.importing import import_logs
from factory.importing.columns import read_table, tidy
from factory.importing.formats.csv.mapping import _divided
from factory.importing.tally import Tally
from factory.samples import Flight
from factory.samples.archives import table_columns
from factory.samples.gliders import write_dbd
from twin.bounded import MOST_UNPACKED, UNPACKED_BYTES, check_unpacked

MOST = 2**30
"""[byte]"""
SMALL = 20 * 2**20
"""[byte]"""
IMPORT = """
import json, os, re, sys
from factory.importing import import_logs
from twin.errors import InputError

for line in sys.stdin:
    kind, path, mapping = json.loads(line)
    if os.fork():  # a process for each file, with the libraries loaded
        os.wait()
        continue
    try:
        import_logs(kind, [path], **({"mapping": mapping} if mapping else {}))
        said = "read"
    except InputError as error:
        said = str(error)
    most = 1024 * int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
    print(json.dumps([said, most]), flush=True)
    os._exit(0)
"""


@pytest.fixture(scope="module")
def imported():
    """A function: what a process of its own says of a file, and its largest memory [byte]."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", IMPORT], **pipes) as process:

        def bring(kind, path, mapping=""):
            assert path.stat().st_size < SMALL
            print(json.dumps([kind, str(path), str(mapping)]), file=process.stdin, flush=True)
            return json.loads(process.stdout.readline())

        yield bring
        process.stdin.close()


def gzipped(name, kind, first, piece=b"", times=0):
    """A maker of a packed file that begins so and goes on with the same."""

    def make(folder):
        with gzip.open(folder / name, "wb", compresslevel=1) as file:
            file.write(first)
            for _ in range(times):
                file.write(piece)
        return kind, folder / name

    return make


PACKET = struct.pack("<HHHdHBHB", 0xFE54, 1, 0, 1.7e9, 1, 1, 1, 1) + b"\0\0"


def long_line(folder):
    path = folder / "sea009_M3_gli.csv"
    path.write_text("Timestamp,Depth\n" + "1," * 4_000_000 + "\n")
    return "seaexplorer", path


def lz4_blocks(folder):
    lz4 = pytest.importorskip("lz4.block")
    path = folder / "a.dcd"
    block = lz4.compress(bytes(32 * 1024), store_size=False)
    path.write_bytes((len(block).to_bytes(2, "big") + block) * 100_000)
    return "slocum", path


def deflated(folder):
    path = folder / "a.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", 50_000_000)
        for name in ("time", "depth", "lat", "lon"):
            one = file.createVariable(name, "f4", ("time",), zlib=True, chunksizes=(10**6,))
            one[:: 10**6] = 1.0
    return "ngdac", path


def empty_hdf5(folder):
    """Chunks that were never written."""
    path = folder / "a.mat"
    with netCDF4.Dataset(path, "w") as file:
        for name in ("depth", "latitude", "longitude"):
            group = file.createGroup(name)
            group.createDimension("n", 10**9)
            group.createVariable("value", "i1", ("n",), zlib=True, chunksizes=(10**6,))
    return "lrauv", path


def parquet(folder):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = folder / "a.parquet"
    words = pyarrow.array(["x" * 1000] * 200_000)
    time = np.arange(200_000.0)
    parquet.write_table(pyarrow.table({"time": time, "m_depth": time, "name": words}), path)
    return "slocum", path


def parquet_of_zeros(folder):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = folder / "a.parquet"
    zeros = np.zeros(10_000_000)
    parquet.write_table(pyarrow.table({"time": zeros, "m_depth": zeros}), path)
    return "slocum", path


TABLE = gzipped("sea009_M3_gli.csv.gz", "seaexplorer", b"Timestamp,Depth\n", b"1,0\n" * 2**18, 400)
PACKETS = gzipped("Data.lsf.gz", "lsf", b"", PACKET * 2**16, 400)
ENDLESS_LINE = gzipped("Data.lsf.gz", "lsf", bytes(2**25))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (TABLE, "unpacks to"), (long_line, "Expected 3 fields"), (PACKETS, "unpacks to"),
        (lz4_blocks, "unpacks to"), (deflated, "unpacks to"), (empty_hdf5, "unpacks to"),
        (ENDLESS_LINE, "first line of more than"), (parquet_of_zeros, "unpacks to"), (parquet, ""),
    ],
)  # fmt: skip
def test_a_small_file_fills_no_memory(imported, make, told, tmp_path):
    kind, path = make(tmp_path)
    said, most = imported(kind, path)
    assert most < MOST
    assert told in said
    if told:
        assert path.name in said
        assert len(said.splitlines()) == 1


MAPPING = """vehicle = "x"
frame = "FRD"
rows = "{rows}"
gap_s = 1e12
[time]
column = "t"
unit = "s"
[signals]
measured_depth = {{ column = "z", unit = "m" }}
measured_dvl_surge = {{ column = "u", unit = "m/s" }}
measured_heading = {{ column = "h", unit = "deg", north = "true" }}
latitude = {{ column = "lat", unit = "deg" }}
longitude = {{ column = "lon", unit = "deg" }}
"""


def write_jump(path, jump, rows=1):
    """Two dives to 20 m of a vehicle that goes east; in the middle, rows whose clock is wrong."""
    time = np.arange(2400.0)
    depth = 20.0 * (1.0 - np.abs((time / 1200.0 % 1.0) * 2.0 - 1.0))
    wrong = (time >= 1200) & (time < 1200 + rows)
    columns = [1.7e9 + time + jump * wrong, depth, np.ones(2400), np.full(2400, 90.0),
               np.full(2400, 36.0), -122.0 + 1.11e-5 * time]  # fmt: skip
    np.savetxt(path, np.transpose(columns), "%.7f", ",", header="t,z,u,h,lat,lon", comments="")


@pytest.mark.parametrize("rows", ["dives", "gaps", "file"])
def test_a_clock_that_jumps_once_costs_its_row_alone(imported, tmp_path, rows):
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING.format(rows=rows))
    write_jump(tmp_path / "right.csv", 0.0)
    write_jump(tmp_path / "jump.csv", 1e9)
    said, most = imported("csv", tmp_path / "jump.csv", mapping)
    assert said == "read"
    assert most < MOST
    right, _ = import_logs("csv", [tmp_path / "right.csv"], mapping=mapping)
    found, report = import_logs("csv", [tmp_path / "jump.csv"], mapping=mapping)
    (told,) = (e for e in report.entries if "clock had jumped" in e.detail)
    assert (told.action, told.count) == ("left out", 1)
    for name in ("measured_depth", "measured_heading"):
        np.testing.assert_allclose(found[name].values, right[name].values, atol=0.05)


@pytest.mark.parametrize("jump", [2e7, 1e8, 1e9])
def test_a_part_of_a_log_whose_clock_is_years_off_fills_no_memory(imported, tmp_path, jump):
    """So many rows that nobody can say which clock is right: both parts stay."""
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING.format(rows="dives").replace("gap_s = 1e12\n", ""))
    write_jump(tmp_path / "jump.csv", jump, rows=1200)
    said, most = imported("csv", tmp_path / "jump.csv", mapping)
    assert said == "read"
    assert most < MOST
    found, _ = import_logs("csv", [tmp_path / "jump.csv"], mapping=mapping)
    assert found.sizes["mission"] == 2


def test_a_row_that_is_a_hole_is_left_out(imported, tmp_path):
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING.format(rows="file"))
    write_jump(tmp_path / "jump.csv", 2e7)
    write_jump(tmp_path / "right.csv", 0.0)
    _, most = imported("csv", tmp_path / "jump.csv", mapping)
    assert most < MOST
    found, report = import_logs(
        "csv", [tmp_path / "jump.csv", tmp_path / "right.csv"], mapping=mapping
    )
    assert found.sizes["mission"] == 1
    assert any("231.5 days" in e.detail and e.action == "left out" for e in report.entries)


def test_rows_without_a_time_near_the_others():
    time = np.concatenate([1.7e9 + np.arange(1000.0), [1.2e9, 2.4e9]])
    tally = Tally()
    kept, columns = tidy(time, {"a": time.copy()}, "x", tally)
    assert np.array_equal(kept, time[:1000])
    assert np.array_equal(columns["a"], time[:1000])
    two = np.concatenate([1.7e9 + np.arange(500.0), 1.4e9 + np.arange(500.0)])
    assert len(tidy(two, {"a": two.copy()}, "x", Tally())[0]) == 1000


def test_rows_of_minutes_hold_samples():
    found = _divided(np.array([0.0, 100.0, 6_000_000.0]), 60.0)
    assert found == [(0.0, 60.0), (60.0, 120.0), (5_999_940.0, 6_000_000.0)]


def test_a_file_may_unpack_to_what_logs_have():
    check_unpacked(UNPACKED_BYTES, 1, "a")
    check_unpacked(MOST_UNPACKED * 10**9, 10**9, "a")
    refused(
        r"^a unpacks to 33.6 MB of values or more from 1 bytes",
        UNPACKED_BYTES + 1,
        1,
        "a",
        by=check_unpacked,
    )


def test_a_table_of_text_is_what_it_was(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "a.parquet"
    words = ["b", None, "a", "b"]
    table = {"time": [1.0, 2.0, 3.0, 4.0], "word": words, "n": [1, 2, 3, 4], "b": [True] * 4}
    parquet.write_table(pyarrow.table(table), path)
    found = read_table(path)
    assert found.texts["word"].tolist() == words
    assert {n: v.tolist() for n, v in found.columns.items()} == {
        "time": table["time"], "n": [1.0, 2.0, 3.0, 4.0], "b": [1.0] * 4
    }  # fmt: skip


def test_a_packed_log_of_a_vehicle_is_read(tmp_path):
    """Plain dives compress by far less than the bound."""
    pytest.importorskip("dbdreader")
    content = write_dbd(tmp_path, Flight())[0].read_bytes()
    assert len(content) < 0.2 * MOST_UNPACKED * len(pack(content))
    assert len(table_columns(Flight())) > 0
