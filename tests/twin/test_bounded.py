"""Files made to exhaust a machine are refused in a line, before their content is built."""

import gzip
import os
import zipfile

import numpy as np
import pytest
import xarray as xr
from patience import little_work

from factory.exporting.metadata import parse_metadata
from factory.importing.columns import column_names, read_table
from factory.importing.formats.base import sniff
from factory.importing.netcdf import open_netcdf
from factory.sampling.distribution import Choice, parse_distribution
from factory.sampling.presets import read_changes
from twin import bounded
from twin.errors import CurrentError, InputError, MissionError, StoreError
from twin.mission.plan import Mission
from twin.records.presence import read_attributes
from twin.records.store import open_store, write_zarr
from twin.records.tracks import read_tracks
from twin.water.current.base import parse_current
from twin.water.density import parse_density

SURFACE = '[[segments]]\nkind = "surface"\n'


def one_line(raised) -> str:
    text = str(raised.value)
    assert "\n" not in text
    assert len(text) < 2100
    return text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = " + "[\n" * 5000, "in each other without end"),
        ("x = " + "[" * 5000, "line 1 has more than 2000 characters"),
        ("a." * 20_000 + "a = 1", "line 1 has more than 2000 characters"),
        ("# comment\n" * 30_000, "larger than 262 kB"),
        ("[[segments]]\nkind = []\n", r"unknown kind '\[\]'"),
        ("[[segments]]\nkind = {a = 1}\n", "unknown kind"),
        (SURFACE + "duration_s = 1" + "0" * 400, "duration_s = .* give a finite number"),
        (SURFACE + "duration_s = " + "\n", "is not TOML"),
        ("duration_s = '20'\n" + SURFACE, "duration_s = '20' is not possible: give a number"),
    ],
)
@little_work(2.0)
def test_a_hostile_mission_file_is_one_line(tmp_path, text, message):
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(MissionError, match=message) as raised:
        Mission.from_toml(path)
    one_line(raised)


def test_a_mission_of_the_api_names_the_field():
    with pytest.raises(MissionError, match=r"duration_s = .* give a finite number"):
        Mission.from_dict({"segments": [{"kind": "surface"}], "duration_s": 10**400})


@pytest.mark.parametrize("path", ["a\0.toml", "/", "nowhere.toml", "x" * 5000])
def test_no_path_is_a_traceback(path):
    with pytest.raises(InputError, match="cannot read parameter file"):
        read_changes(path)


def test_a_null_in_a_name_of_the_mini_languages():
    with pytest.raises(CurrentError, match="cannot read the current profile"):
        parse_current("profile:a\0.csv")
    with pytest.raises(InputError, match="cannot read the density file"):
        parse_density("a\0.csv")


def test_a_number_of_thousands_of_digits_is_one_line(tmp_path):
    (tmp_path / "p.toml").write_text(
        "[mission]\npitch_deg = [" + ",\n".join(["9" * 1900] * 3) + "]"
    )
    with pytest.raises(InputError, match=r"mission\.pitch_deg"):
        read_changes(tmp_path / "p.toml")


@pytest.mark.parametrize(
    "text",
    [
        "choice(x: inf)", "choice(x: nan)", "choice(x: 1e308, y: 1e308)", "choice(inf, 2)",
        "choice(x: -1)", "uniform(-1e308, 1e308)", "uniform(0, 1e400)", "normal(nan, 1)",
        "a" * 20_000, "uniform(0, 1) except " + "(2, 3)  " * 40 + "x",
    ],
)  # fmt: skip
@little_work(2.0)
def test_a_hostile_distribution_is_refused_at_once(text):
    with pytest.raises(InputError, match="p "):
        parse_distribution(text, "p")


def test_a_number_beyond_floats_is_refused():
    with pytest.raises(InputError, match="finite"):
        parse_distribution(10**400, "p")
    with pytest.raises(InputError, match="weights must be finite"):
        Choice(("a", "b"), (float("inf"), 1.0))


def test_a_netcdf_file_that_declares_more_than_it_holds(tmp_path):
    import netCDF4

    path = tmp_path / "bomb.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", 10**9)
        file.createVariable("depth", "f8", ("time",), chunksizes=(10**6,), zlib=True)
    assert path.stat().st_size < 100_000
    with (
        pytest.raises(InputError, match=r"bomb.nc unpacks to 8 GB of values .* damaged"),
        open_netcdf(path),
    ):
        pass
    with pytest.raises(InputError, match="declares 8 GB"):
        read_tracks(path, 0)
    with pytest.raises(CurrentError, match="declares 8 GB"):
        parse_current(f"grid:{path}").load(60.0)


def test_an_archive_that_declares_more_than_it_holds(tmp_path):
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("time.npy", "w", force_zip64=True) as entry,
    ):
        zeros = bytes(2**20)
        for _ in range(300):
            entry.write(zeros)
    with pytest.raises(InputError, match="declares 315 MB"):
        read_tracks(path, 0)
    path.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(InputError, match="cannot be read"):
        read_tracks(path, 0)


def test_a_pickle_among_the_arrays_of_tracks_is_refused(tmp_path):
    path = tmp_path / "tracks.npz"
    np.savez(path, time=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="pickle"):
        read_tracks(path, 0)


@little_work(2.0)
def test_a_tracks_csv_with_a_giant_field(tmp_path):
    path = tmp_path / "tracks.csv"
    path.write_text("time,north,east\n0,1," + "9" * 10**6 + "x\n")
    with pytest.raises(InputError, match="line 2") as raised:
        read_tracks(path, 0)
    one_line(raised)
    path.write_text('time,north,east\n0,"' + "1" * 10**6)
    with pytest.raises(InputError) as raised:
        read_tracks(path, 0)
    one_line(raised)


@pytest.mark.parametrize("giant", ["shape", "chunk_shape"])
def test_a_store_that_declares_more_than_it_holds(tmp_path, giant):
    path = tmp_path / "bomb.zarr"
    dataset = xr.Dataset({"depth": (("mission", "time"), np.zeros((1, 1)))})
    dataset.attrs["schema_version"] = 1
    write_zarr(dataset, path)
    for name in ("zarr.json", "depth/zarr.json"):
        file = path / name
        text = file.read_text()
        text = "".join(text.split())
        assert f'"{giant}":[1,1]' in text
        file.write_text(text.replace(f'"{giant}":[1,1]', f'"{giant}":[100000,100000]'))
    with pytest.raises(StoreError, match="declares 80 GB of values"):
        open_store(path)


def test_metadata_nested_without_end_is_one_line(tmp_path):
    (tmp_path / "zarr.json").write_text('{"attributes": ' + "[" * 100_000)
    with pytest.raises(StoreError, match="in each other without end") as raised:
        read_attributes(tmp_path)
    one_line(raised)


@little_work(2.0)
def test_deployment_metadata_that_multiplies_itself():
    laughs = "a0: &a0 {x: 1}\n" + "".join(
        f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 9)
    )
    with pytest.raises(InputError, match=r"references \(\*name\)"):
        parse_metadata(laughs + "metadata: *a8\n", "m.yml")
    with pytest.raises(InputError, match="inside each other"):
        parse_metadata("metadata: " + "[" * 5000, "m.yml")
    with pytest.raises(InputError, match="longer than 256 kB"):
        parse_metadata("metadata: {}\n" + "# x\n" * 100_000, "m.yml")
    with pytest.raises(InputError, match="not YAML"):
        parse_metadata("metadata: {a: 2022-13-45}", "m.yml")
    with pytest.raises(InputError, match="not YAML"):
        parse_metadata("metadata: !!python/object/apply:os.system [x]", "m.yml")


def test_what_is_declared_may_be_large_where_the_file_is():
    bounded.check_declared(8e9, 10**8, "a log")
    bounded.check_declared(2e8, 10, "a small file")
    with pytest.raises(InputError, match="1 TB of values in 1 kB"):
        bounded.check_declared(1e12, 1000, "a bomb")


@pytest.mark.parametrize(
    "pattern",
    [
        "(a+)+$", "(a|a)*$", "(?:a*)*", "(a{1,9}){1,9}", "([a-z]+)*", r"(\w+\s?)+", "a*a*a*a*b",
        "a?" * 30 + "a" * 30, "(?P<d>x+){2,}", "(a*)?" * 4, "a{1,200}" * 3, "(?=(a+))+",
        "[]a]*[^]]*[x]*b",
    ],
)  # fmt: skip
def test_a_pattern_that_could_take_without_end_is_refused(pattern):
    with pytest.raises(InputError, match="p could take without end"):
        bounded.compile_pattern(pattern, "p")


@pytest.mark.parametrize(
    ("pattern", "name", "found"),
    [
        (r"^(\d{8})_", "20220625_x.csv", "20220625"),
        (r"_(\d{4}-?\d{2}-?\d{2})(?:T\d{6})?\.csv$", "a_2022-06-25.csv", "2022-06-25"),
        (r"[*+?]*-(.+)[)]", "a++-2022)", "2022"),
        (r".*_(?P<date>\d+)\)", "a_b_2022)", "2022"),
    ],
)
def test_the_patterns_of_users_are_taken(pattern, name, found):
    assert bounded.compile_pattern(pattern, "p").search(name).group(1) == found


@little_work(5.0)
def test_no_allowed_pattern_takes_long():
    name = "a" * 255
    for pattern in (".*.*b", "a?" * 2 + "a*a*b", "a{1,200}a{1,200}a?a?b"):
        assert bounded.compile_pattern(pattern, "p").search(name) is None


@pytest.mark.parametrize("pattern", ["(", "[[a]", "a{99999999999999}", "(" * 5000 + ")" * 5000])
def test_what_is_no_pattern_is_one_line(pattern):
    with pytest.raises(InputError, match="p is not a regular expression") as raised:
        bounded.compile_pattern(pattern, "p")
    one_line(raised)


@little_work(10.0)
def test_a_compressed_table_that_unpacks_without_end(tmp_path):
    path = tmp_path / "log.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"time,depth\n")
        for _ in range(40):
            file.write(b"1,0\n" * 2**18)
    with pytest.raises(InputError, match=r"log\.csv\.gz unpacks to .* or more from") as raised:
        read_table(path)
    one_line(raised)


def test_a_table_whose_first_line_does_not_end(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"a," * 10**6)
    for read in (read_table, column_names):
        with pytest.raises(InputError, match="first line of more than") as raised:
            read(path)
        one_line(raised)


def pipe(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


def folder(path):
    path.mkdir()


ODD = {pipe: "a named pipe", device: "a link to a device", folder: "a folder"}


@pytest.mark.parametrize("make", ODD)
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("m.toml", Mission.from_toml),
        ("p.toml", read_changes),
        ("d.csv", lambda path: parse_density(str(path))),
        ("c.csv", lambda path: parse_current(f"profile:{path}")),
        ("c.nc", lambda path: parse_current(f"grid:{path}").load(60.0)),
        ("t.csv", read_tracks),
        ("t.npz", read_tracks),
        ("t.nc", read_tracks),
        ("l.csv", sniff),
    ],
)
@little_work(10.0)
def test_a_file_without_an_end_is_refused_by_name(tmp_path, make, name, read):
    path = tmp_path / name
    make(path)
    with pytest.raises((InputError, StoreError)) as raised:
        read(path)
    assert name in str(raised.value)
    if make is not folder:  # some take folders, and say what those lack
        assert f"it is {ODD[make]}, not a file" in str(raised.value)
