"""Store paths: what is an address, and that no address becomes a folder of this machine."""

from pathlib import Path

import pytest

from factory.importing import import_logs
from learn.run_folder import training_folder
from twin.__main__ import PROGRAM
from twin.errors import InputError
from twin.records.reader import MissionStore
from twin.records.storage.store_path import Url, check_addresses, store_path
from twin.records.storage.whole import whole_file, whole_folder
from twin.records.store import open_trajectory
from twin.records.tracks import read_tracks

UNKNOWN = ("gcs://b/run.zarr", "abfs://b/x.zarr", "https://a.b/x.zarr", "memory://x/y.zarr",
           "file:///tmp/x.zarr", "S3://b/x.zarr", "s3a://b/x.nc",
           "hdfs:/b/x.zarr", "gcs://")  # fmt: skip


@pytest.mark.parametrize("address", UNKNOWN)
@pytest.mark.parametrize("kind", [str, Path])
def test_an_address_of_an_unknown_kind_is_no_path(address, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scheme = address.partition(":")[0]
    place = kind(address)

    def write(context):
        with context(place):
            pass

    for use in (
        lambda: store_path(place),
        lambda: check_addresses([Path("a"), Path(place)]),
        lambda: write(whole_file),
        lambda: write(whole_folder),
        lambda: open_trajectory(place),
        lambda: MissionStore(place),
        lambda: read_tracks(place),
        lambda: import_logs("slocum", [place]),
        lambda: training_folder(Path(place), replace=False),
    ):
        with pytest.raises(InputError, match=rf"{scheme}://.*: unknown kind of address '{scheme}'"):
            use()
    assert not list(tmp_path.iterdir())


def test_what_is_near_is_offered():
    with pytest.raises(InputError, match=r"unknown kind of address 'gcs': did you mean 'gs'\?"):
        store_path(Path("gcs://b/x.zarr"))


@pytest.mark.parametrize("place", ["a/b.zarr", "/a:/b.zarr", "a/b:/c", "./x:y", "x:y", "..", "~/a"])
def test_what_is_no_address_is_a_path(place):
    assert store_path(place) == Path(place)
    assert store_path(Path(place)) == Path(place)


@pytest.mark.parametrize("place", ["s3://b/x.zarr", "gs:/b/x.zarr", Path("az://b/c/x.zarr")])
def test_an_address_that_is_known_is_one(place):
    found = store_path(place)
    assert isinstance(found, Url)
    assert str(found) == str(place).replace("://", ":/").replace(":/", "://")
    assert store_path(found) == found


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--duration", "5", "--out", "gcs://b/run.zarr"],
        ["flight", "gcs://b/x.zarr"], ["flight", "x.zarr", "--out", "gcs://b/f.nc"],
        ["plot", "gcs://b/x.zarr"], ["render", "x.zarr", "--out", "gcs://b/f.mp4"],
    ],
)  # fmt: skip
def test_every_command_refuses_an_address_of_an_unknown_kind(
    words, tmp_path, monkeypatch,
    capsys
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert PROGRAM.main(words) == 2
    assert "unknown kind of address 'gcs': did you mean 'gs'?" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
