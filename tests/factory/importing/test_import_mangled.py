"""Logs as real life mangles them: each comes in whole, or one line says what is wrong."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from logs import Flight, write_basestation, write_mat, write_og1, write_seaglider, write_table

from factory.importing import import_logs
from twin.errors import InputError

FLIGHT = Flight(dives=2)
PAGE = (Path(__file__).resolve().parents[3] / "docs" / "howto" / "import_tables.md").read_text()


def with_semicolons(content: bytes) -> bytes:
    """As a spreadsheet writes it where the decimal is a comma."""
    return content.replace(b",", b";").replace(b".", b",")


@pytest.mark.parametrize(
    "mangle",
    [
        lambda content: content.decode().encode("utf-16"),
        lambda content: b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"),
        lambda content: content + content,
        with_semicolons,
        lambda content: content[: len(content) - 7],
        lambda content: content.replace(b"\n", b"\n\n"),
    ],
    ids=["utf-16", "bom and crlf", "its header again", "decimal commas", "cut", "empty lines"],
)
def test_tables_of_other_programs_come_in_whole(
    mangle: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    (table,) = write_table(tmp_path, FLIGHT, PAGE)
    table.write_bytes(mangle(table.read_bytes()))
    _, report = import_logs("csv", [table], mapping=tmp_path / "mine.toml")
    assert report.rows == FLIGHT.dives


def test_a_table_without_a_value_is_refused_in_one_line(tmp_path: Path) -> None:
    (table,) = write_table(tmp_path, FLIGHT, PAGE)
    header, *rows = table.read_text().splitlines()
    bare = [",".join([row.split(",")[0], *["nan"] * header.count(",")]) for row in rows]
    table.write_text("\n".join([header, *bare]))
    with pytest.raises(InputError, match=r"^log\.csv: no signal has a value$"):
        import_logs("csv", [table], mapping=tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("kind", "write"),
    [
        ("og1", lambda folder: [write_og1(folder / "a.nc", FLIGHT)]),
        ("lrauv", lambda folder: [write_mat(folder / "a.mat", FLIGHT)]),
        ("seaglider", lambda folder: write_basestation(folder, FLIGHT)),
    ],
)
def test_copies_in_another_folder_are_read_once(
    kind: str, write: Callable[[Path], list[Path]], tmp_path: Path
) -> None:
    files = write(tmp_path)
    (tmp_path / "backup").mkdir()
    copies = [Path(shutil.copy(path, tmp_path / "backup" / path.name)) for path in files]
    _, report = import_logs(kind, [*files, *copies])
    assert report.rows == FLIGHT.dives
    assert report.count("left out", "files") == len(copies)


def test_a_spoilt_row_of_a_table_of_dives_is_left_out(tmp_path: Path) -> None:
    write_seaglider(tmp_path, FLIGHT)
    (dives,) = tmp_path.glob("*_dives.csv")
    lines = dives.read_text().splitlines()
    dives.write_text("\n".join([*lines, lines[-1].replace("SG999", "S?999")]))
    _, report = import_logs("seaglider", sorted(tmp_path.glob("*.csv")))
    assert report.rows == FLIGHT.dives
    assert report.count("left out", "S?999") == 1


def test_a_failed_import_names_what_could_not_be_read(tmp_path: Path) -> None:
    write_seaglider(tmp_path, FLIGHT)
    (dives,) = tmp_path.glob("*_dives.csv")
    dives.write_text("")
    with pytest.raises(InputError, match=r"magnetic.*left out before: .*_dives\.csv is empty"):
        import_logs("seaglider", sorted(tmp_path.glob("*.csv")))


def test_what_is_wrong_with_the_only_file_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "zero.dbd").touch()
    with pytest.raises(InputError, match=r"^\S*zero\.dbd is empty$"):
        import_logs("slocum", [tmp_path / "zero.dbd"])


@pytest.mark.parametrize("kind", ["csv", "slocum", "lrauv", "seaglider"])
def test_a_web_page_and_a_store_are_called_what_they_are(kind, tmp_path):
    page = tmp_path / "log.csv"
    page.write_text("\n<!DOCTYPE html><html><body>please log in</body></html>")
    with pytest.raises(InputError, match=r"log.csv is a web page \(HTML\) and no log"):
        import_logs(kind, [page])
    store = tmp_path / "real.zarr"
    store.mkdir()
    (store / "zarr.json").write_text("{}")
    with pytest.raises(InputError, match="is a store already; name the logs"):
        import_logs(kind, [store])
