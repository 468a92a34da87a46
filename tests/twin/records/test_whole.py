"""Whole files and folders: the old content or the new one, and nothing else beside it."""

import errno
import os
import subprocess
import sys

import pytest

from twin.errors import WriteError
from twin.records.storage import disk, whole
from twin.records.storage.checksums import damaged_files
from twin.records.storage.disk import sweep, write_whole
from twin.records.storage.whole import check_folder_target, recover, whole_file, whole_folder


def write(path, text, **options):
    with whole_folder(path, **options) as folder:
        (folder / "inside").mkdir()
        (folder / "inside" / "text").write_text(text)


def text_of(path):
    assert list(damaged_files(path)) == []
    return (path / "inside" / "text").read_text()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(params=["exchange", "aside"])
def renaming(request, monkeypatch):
    """File systems that exchange names, and those that do not."""
    if request.param == "aside":
        monkeypatch.setattr(whole, "exchange", lambda one, other: False)


def test_a_folder_appears_whole_with_its_checksums(tmp_path):
    target = tmp_path / "made" / "also" / "target"
    with whole_folder(target) as folder:
        (folder / "a").write_text("a")
        assert not target.exists()
        assert folder.name == target.name
    assert names(target) == ["a", "checksums.json"]
    assert names(target.parent) == ["target"]


def test_a_place_where_no_folder_can_be_made_is_named(tmp_path, monkeypatch):
    """As /proc does: its folder is there, and a new one is refused as if it were not."""

    def refuse(path, *args, **kwargs):
        if path == tmp_path:
            return
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))

    monkeypatch.setattr(whole.Path, "mkdir", refuse)
    monkeypatch.setattr(whole, "clean", lambda target: None)
    tries = iter(range(10))
    tried = lambda path: path.with_name(f".{path.name}.writing-{next(tries)}")  # noqa: E731
    monkeypatch.setattr(whole, "temporary_name", tried)
    with (
        pytest.raises(WriteError, match=r"cannot write .*target: .*No such file or directory"),
        whole_folder(tmp_path / "target"),
    ):
        pass


def test_what_was_there_stays_until_the_new_is_complete(tmp_path, renaming):
    target = tmp_path / "target"
    write(target, "old")
    with whole_folder(target, overwrite=True) as folder:
        assert text_of(target) == "old"
        (folder / "inside").mkdir()
        (folder / "inside" / "text").write_text("new")
    assert text_of(target) == "new"
    assert names(tmp_path) == ["target"]


def test_an_error_leaves_what_was_there_and_nothing_beside_it(tmp_path, renaming):
    target = tmp_path / "target"
    with pytest.raises(ZeroDivisionError), whole_folder(target) as folder:
        (folder / "half").write_text(str(1 / 0))
    assert names(tmp_path) == []
    write(target, "old")
    with pytest.raises(ZeroDivisionError), whole_folder(target, overwrite=True) as folder:
        (folder / "half").write_text(str(1 / 0))
    assert text_of(target) == "old"
    assert names(tmp_path) == ["target"]


def test_what_is_not_ours_is_never_replaced(tmp_path):
    (tmp_path / "target").mkdir()
    (tmp_path / "target" / "precious").touch()
    with pytest.raises(WriteError, match="glider-twin did not write it; remove it by hand"):
        write(tmp_path / "target", "new", overwrite=True)
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match="is not a folder"):
        write(tmp_path / "file", "new", overwrite=True)
    write(tmp_path / "ours", "old")
    with pytest.raises(
        WriteError, match=r"already exists; use --overwrite \(in Python overwrite=True\)"
    ):
        write(tmp_path / "ours", "new")
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", "new")
    assert names(tmp_path) == ["empty", "file", "ours", "target"]


def test_a_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    write(tmp_path / "far" / "target", "old")
    (tmp_path / "link").symlink_to(tmp_path / "far" / "target")
    write(tmp_path / "link", "new", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert text_of(tmp_path / "far" / "target") == "new"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EROFS])
def test_a_disk_that_refuses_is_told_in_one_line(tmp_path, monkeypatch, code):
    def refuse(descriptor):
        raise OSError(code, os.strerror(code))

    write(tmp_path / "target", "old")
    monkeypatch.setattr(disk.os, "fsync", refuse)
    with pytest.raises(WriteError, match=f"cannot write .*target: {os.strerror(code)};") as told:
        write(tmp_path / "target", "new", overwrite=True)
    assert "\n" not in str(told.value)
    monkeypatch.undo()
    assert text_of(tmp_path / "target") == "old"
    assert names(tmp_path) == ["target"]


def test_a_file_that_cannot_be_read_is_not_called_one_that_cannot_be_written(tmp_path):
    with pytest.raises(FileNotFoundError), whole_folder(tmp_path / "target"):
        (tmp_path / "input").read_text()
    assert names(tmp_path) == []


def test_an_interrupt_says_how_to_go_on(tmp_path):
    said = r"nothing half-written is left under .*target"
    with pytest.raises(KeyboardInterrupt, match=said), whole_folder(tmp_path / "target"):
        raise KeyboardInterrupt
    assert names(tmp_path) == []


KILLED = """
import os, sys, time
from pathlib import Path
from twin.records.storage import whole
target, how = Path(sys.argv[1]), sys.argv[2]
if how == "between":
    whole.exchange = lambda one, other: False
    rename = Path.rename
    def between(self, other):
        rename(self, other)
        os._exit(9)
    Path.rename = between
with whole.whole_folder(target, overwrite=True) as folder:
    (folder / "inside").mkdir()
    (folder / "inside" / "text").write_text("new")
    if how == "inside":
        os._exit(9)
    if how == "lives":
        print("ready", flush=True)
        sys.stdin.read()
"""


def run(target, how, **options):
    return subprocess.Popen([sys.executable, "-c", KILLED, str(target), how], **options)


def test_the_next_writer_removes_what_a_killed_one_left(tmp_path):
    target = tmp_path / "target"
    write(target, "old")
    assert run(target, "inside").wait() == 9
    assert text_of(target) == "old"
    assert len(names(tmp_path)) == 2
    write(target, "newer", overwrite=True)
    assert text_of(target) == "newer"
    assert names(tmp_path) == ["target"]


@pytest.mark.parametrize("next_one", ["reader", "writer"])
def test_a_kill_between_two_renames_is_finished_by_the_next(tmp_path, next_one):
    target = tmp_path / "target"
    write(target, "old")
    assert run(target, "between").wait() == 9
    assert not target.exists()
    if next_one == "reader":
        recover(target)
        assert text_of(target) == "new"
    else:
        with pytest.raises(WriteError, match="already exists"):
            check_folder_target(target)
        write(target, "newer", overwrite=True)
        assert text_of(target) == "newer"
        assert names(tmp_path) == ["target"]


def test_what_a_living_writer_works_in_stays(tmp_path):
    target = tmp_path / "target"
    write(target, "old")
    other = run(target, "lives", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert other.stdout.readline() == b"ready\n"
    write(target, "mine", overwrite=True)
    assert text_of(target) == "mine"
    assert len(names(tmp_path)) == 2
    other.communicate(b"")
    assert other.returncode == 0
    assert text_of(target) == "new"
    assert names(tmp_path) == ["target"]


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "figure.txt"
    with whole_file(target) as path:
        assert path.name == target.name
        assert path.parent.name.startswith(".figure.txt.writing-")
        path.write_text("one")
        assert not target.exists()
    target.chmod(0o600)
    with whole_file(target) as path:
        path.write_text("two")
        assert target.read_text() == "one"
    assert target.read_text() == "two"
    assert target.stat().st_mode & 0o777 == 0o600
    with pytest.raises(ZeroDivisionError), whole_file(target) as path:
        path.write_text(str(1 / 0))
    assert target.read_text() == "two"
    assert names(tmp_path) == ["figure.txt"]


def test_a_file_does_not_replace_what_is_no_file(tmp_path):
    with pytest.raises(WriteError, match="is a folder"), whole_file(tmp_path):
        pass
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(WriteError, match="is not a plain file"), whole_file(tmp_path / "pipe"):
        pass
    (tmp_path / "there").touch()
    for path, why in (("there", "use --overwrite"), ("there/below", "there is a file")):
        target = tmp_path / path
        with pytest.raises(WriteError, match=why), whole_file(target, overwrite=False):
            pass


def test_small_files_are_whole_and_their_left_overs_are_swept(tmp_path):
    write_whole(tmp_path / "a", b"one")
    write_whole(tmp_path / "a", b"two")
    assert (tmp_path / "a").read_bytes() == b"two"
    assert names(tmp_path) == ["a"]
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / ".b.writing-01234567").write_bytes(b"half")
    (tmp_path / "deep" / ".c.writing-01234567").mkdir()
    with whole_file(tmp_path / "deep" / "living") as path:
        path.touch()
        sweep(tmp_path)
    assert names(tmp_path / "deep") == ["living"]


@pytest.mark.parametrize("writer", [whole_folder, whole_file])
def test_of_two_writers_at_once_the_second_to_end_is_refused(tmp_path, writer):
    """What the first one wrote stays: neither was told to overwrite."""
    target = tmp_path / "run"

    def both():
        with writer(target, overwrite=False) as late:
            _fill(late, "late")
            with writer(target, overwrite=False) as first:
                _fill(first, "first")

    with pytest.raises(WriteError, match="already exists"):
        both()
    assert _content(target) == "first"
    assert names(tmp_path) == ["run"]


def _fill(place, text):
    """A file's text, in a folder that is there or as the file."""
    (place / "content" if place.is_dir() else place).write_text(text)


def _content(place):
    return (place / "content" if place.is_dir() else place).read_text()


def test_many_writers_at_once_leave_one_whole_folder(tmp_path):
    target = tmp_path / "target"
    write(target, "old")
    others = [run(target, "plain") for _ in range(3)]
    assert [other.wait() for other in others] == [0, 0, 0]
    assert text_of(target) == "new"
    assert names(tmp_path) == ["target"]
