"""Printed names: what stands in a log, or is a file's name, moves no cursor of who reads it."""

from factory.__main__ import PROGRAM
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from twin.show.figures.page_layout import Page

MARKS = "\x1b]0;owned\x07\x9b2J\u202e"


def readable(text):
    return all(one.isprintable() or one == "\n" for one in text)


def test_names_of_files_and_deployments_are_shown_and_do_nothing(tmp_path, capsys):
    folder = tmp_path / f"logs{MARKS}"
    folder.mkdir()
    for path in write_slocum(folder, Flight(depth=50.0)):
        path.rename(folder / f"unit{MARKS}{path.name}")
    (folder / f"x{MARKS}.csv").write_text("a,b\n1,2\n")
    (folder / f"y{MARKS}.dbd").write_bytes(b"no log")
    store = tmp_path / f"s{MARKS}.zarr"
    for words in (
        ["import", "slocum", folder, "--out", store],
        ["info", store],
        ["verify", store],
        ["import", "slocum", folder, "--out", store],
        ["import", "slocum", folder / f"{MARKS}.csv", "--out", tmp_path / "o"],
    ):
        code = PROGRAM.main([str(word) for word in words])
        said = capsys.readouterr()
        assert code in (0, 1, 2)
        assert "bug" not in said.err
        assert readable(said.out)
        assert readable(said.err)
        assert "\\x1b]0;owned\\x07\\x9b2J\\u202e" in said.out + said.err


def test_a_page_and_what_lies_beside_it_show_the_marks(tmp_path):
    page = Page(tmp_path / "page", f"title{MARKS}<b>", MARKS)
    page.facts({MARKS: MARKS})
    page.code(MARKS)
    page.attach("boxes.txt", f"{MARKS}\n")
    page.write()
    for name in ("index.html", "boxes.txt"):
        text = (tmp_path / "page" / name).read_text(encoding="utf-8")
        assert readable(text)
        assert "\\u202e" in text
    assert "<b>" not in text
