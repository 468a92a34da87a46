"""Every registered importer: complete, documented, told from the others; and a user's own one."""

import dataclasses
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import netCDF4
import pytest
from examples import OWN
from logs import LAYOUTS, refused, write

from factory import samples
from factory.importing import IMPORTERS, import_logs, sniff
from factory.importing.columns import column_names
from factory.importing.netcdf import holds_arrays
from factory.samples import Flight, write_csv
from glider_twin_protocols.auv_samples import ENTITIES
from twin.errors import InputError
from twin.records.schema import VARIABLES
from twin.records.store import open_store

ROOT = Path(__file__).resolve().parents[3]
HOWTO = ROOT / "docs" / "howto"
PAGE = (HOWTO / "import_logs.md").read_text()
FLIGHT = Flight(depth=100.0, surface=600.0)


def test_every_format_that_lies_in_the_folder_is_registered():
    """A format is a folder, or files that begin with its name; its reader lies there."""
    folder = ROOT / "factory" / "importing" / "formats"
    files = {path.stem for path in folder.glob("*.py")} - {"__init__", "base", "kinds"}
    folders = {path.parent.name for path in folder.glob("*/__init__.py")}
    assert {name.partition("_")[0] for name in files} | folders == set(IMPORTERS.shipped())
    for name in IMPORTERS.shipped():
        assert str(IMPORTERS[name].read).startswith(f"factory.importing.formats.{name}")


def names_in(path):
    """Every name of a file, found without the importers, by the library of its format."""
    if path.suffix in (".mcap", ".db3"):
        from rosbags.highlevel import AnyReader

        whole = path.parent if (path.parent / "metadata.yaml").exists() else path
        with AnyReader([whole]) as reader:
            return {one.topic for one in reader.connections}
    if path.suffix == ".BIN":
        from pymavlink.DFReader import DFReader_binary

        log, found = DFReader_binary(str(path)), set()
        while (message := log.recv_msg()) is not None:
            found.add(message.get_type())
        log.close()
        return found
    if path.suffix == ".log":
        header = path.read_bytes().partition(b"# begin")[0].decode()
        return {line.split()[2] for line in header.splitlines()[1:]}
    if path.suffix == ".lsf":
        from imcpy.lsf import LSFReader

        messages = LSFReader.read(path.read_bytes(), use_index=False)
        sent = {(one.msg_name, ENTITIES[one.src_ent].replace(" ", "_")) for one in messages}
        return {name if name == "EntityInfo" else f"{name}/{sender}" for name, sender in sent}
    if path.suffix == ".dbd":
        lines = path.with_name("0badcafe.cac").read_text().splitlines()
        return {line.split()[5] for line in lines}
    if not holds_arrays(path):
        return set(column_names(path))

    def inside(group):
        found = set()
        for name, one in group.groups.items():
            found |= {name} if {"time", "value"} <= set(one.variables) else inside(one)
        return found | (set(group.variables) if not group.parent or not found else set())

    with netCDF4.Dataset(path) as file:
        return inside(file)


@pytest.mark.parametrize(("kind", "layout"), LAYOUTS)
def test_each_name_of_a_file_is_accounted_for_once(kind, layout, tmp_path):
    paths = write(kind, layout, tmp_path / "logs", FLIGHT)
    given = {"variation_deg": FLIGHT.variation, **samples.options(kind, tmp_path / "logs", FLIGHT)}
    _, report = import_logs(kind, paths, **given)
    named = [
        name for states in report.names.values() for names in states.values() for name in names
    ]
    for states in report.names.values():
        every = [name for names in states.values() for name in names]
        assert len(every) == len(set(every))
    wanted = set().union(*(names_in(path) for path in paths if path.suffix != ".cac"))
    assert wanted <= set(named), f"not told of: {sorted(wanted - set(named))}"
    assert set(named) <= wanted, f"invented: {sorted(set(named) - wanted)}"


@pytest.mark.parametrize(("kind", "layout"), [one for one in LAYOUTS if one[0] != "csv"])
def test_logs_are_told_from_those_of_every_other_kind(kind, layout, tmp_path):
    paths = [p for p in write(kind, layout, tmp_path / "logs", FLIGHT) if p.suffix != ".cac"]
    for path in paths:
        assert sniff(path) == sniff(str(path)) == kind, path.name
        for other in IMPORTERS.names():
            if other == kind:
                continue
            with pytest.raises(InputError, match=re.escape(path.name)) as caught:
                import_logs(other, [path], variation_deg=0.0)
            assert "\n" not in str(caught.value)
            if path.suffix != ".dbd":  # its names are in another file
                assert f"looks like {kind}: use `factory import {kind}`" in str(caught.value)


def what_is_wrong(kind, path):
    try:
        import_logs(kind, [path], variation_deg=0.0)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("kind", "layout"),
    [
        ("ngdac", "profiles"),
        ("og1", "netcdf"),
        ("spray", "binned"),
        ("seaglider", "basestation"),
        ("lrauv", "nc4"),
        ("dorado", "product"),
    ],
)
def test_advice_never_goes_in_a_circle(kind, layout, tmp_path):
    """A file that lost what its kind needs: the kind that an error names takes it, or says why."""
    path = write(kind, layout, tmp_path / "logs", FLIGHT)[0]
    with netCDF4.Dataset(path) as file:
        needed = [n for n in file.variables if n.lower() in ("time", "depth", "pressure", "pres")]
    for lost in needed:
        spoilt = tmp_path / f"{lost}.nc"
        spoilt.write_bytes(path.read_bytes())
        with netCDF4.Dataset(spoilt, "a") as file:
            file.renameVariable(lost, "LOST")
        for asked in ("slocum", "seaglider", "og1", "ngdac", "spray", "lrauv", "dorado"):
            named = re.search(r"looks like (\w+)", what_is_wrong(asked, spoilt))
            if named is not None:
                said = what_is_wrong(named[1], spoilt)
                assert "is not a log of the kind" not in said, (asked, lost)


def test_a_folder_of_other_logs_names_their_kind(tmp_path):
    write("seaglider", "basestation", tmp_path / "logs", FLIGHT)
    refused(r"p9990001\.nc looks like seaglider: use", "slocum", [tmp_path / "logs"])


def test_a_file_that_looks_like_no_log(tmp_path):
    path = write_csv(tmp_path / "prices.csv", {"fish": [1, 2], "price": [3, 4]})
    assert sniff(path) is None
    refused(r"prices\.csv is not a log of the kind slocum .* fish", "slocum", [path])


@pytest.mark.parametrize("importer", list(IMPORTERS.values()), ids=lambda one: one.name)
def test_the_page_has_a_command_of_each_importer(importer):
    assert f"factory import {importer.name} " in PAGE


@pytest.mark.parametrize("importer", list(IMPORTERS.values()), ids=lambda one: one.name)
def test_channels_and_extras_exist(importer):
    assert importer.held | importer.lacks <= set(VARIABLES)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    known = extras["optional-dependencies"]
    assert importer.extra is None or importer.extra in known or (ROOT / importer.extra).is_dir()


@pytest.mark.parametrize("importer", list(IMPORTERS.values()), ids=lambda one: one.name)
def test_marks_belong_to_one_kind(importer):
    for other in IMPORTERS.values():
        assert other is importer or not importer.marks & other.marks


@pytest.mark.parametrize("kind", [i.name for i in IMPORTERS.values() if not i.takes_cache])
def test_a_cache_is_refused_where_nothing_reads_it(kind, tmp_path):
    refused(f"{kind} logs have no cache files.*for slocum", kind, [tmp_path], cache=tmp_path)


@pytest.mark.parametrize("kind", [i.name for i in IMPORTERS.values() if not i.takes_mapping])
def test_a_mapping_is_refused_where_names_are_known(kind, tmp_path):
    refused(f"{kind} logs have names of their own.*csv", kind, [tmp_path], mapping=tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "My Logs"}, "small letters"),
        ({"files": ""}, "files is empty"),
        ({"marks": frozenset()}, "marks is empty"),
        ({"suffixes": frozenset({"csv"})}, "suffix 'csv' must begin with a dot"),
        ({"period": 0.0}, "period must be within"),
        ({"read": "a string"}, "read must be a function"),
    ],
)
def test_half_an_importer_is_refused(change, message):
    refused(message, IMPORTERS["og1"], **change, by=dataclasses.replace)


def test_an_importer_of_ones_own_is_one_file_outside_the_package(tmp_path):
    state = FLIGHT.state(FLIGHT.time)
    write_csv(
        tmp_path / "log.csv",
        {"time": FLIGHT.time, "my_depth": state["depth"], "my_pitch": state["pitch"]},
    )

    def call(*words):
        environment = {**os.environ, "GLIDER_TWIN_PLUGINS": str(OWN / "my_logs.py")}
        out = ["--out", str(tmp_path / "own.zarr")]
        return subprocess.run(
            [sys.executable, "-m", "factory", "import", *words, *out],
            cwd=ROOT, env=environment, capture_output=True, text=True,
        )  # fmt: skip

    done = call("mine", str(tmp_path / "log.csv"))
    assert done.returncode == 0, done.stderr
    store = open_store(tmp_path / "own.zarr")
    assert store.sizes["mission"] == FLIGHT.dives
    assert store.attrs["sample_period_s"] == 5.0
    # the others know it, too
    done = call("seaglider", str(tmp_path / "log.csv"), "--overwrite")
    assert done.returncode == 2
    assert "looks like mine" in done.stderr
    help_text = call("--help").stdout
    assert "mine" in help_text
