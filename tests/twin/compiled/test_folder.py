"""Compiled code is kept only where no other user can write, at every level."""

import os
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from twin.compiled import folder

ME, OTHER = 1000, 1001
HOME = {"/": (0, 0o755), "/home": (0, 0o755), "/home/me": (ME, 0o700), "/home/me/c": (ME, 0o700)}
TEMPORARY = {"/": (0, 0o755), "/tmp": (0, 0o1777), "/tmp/c": (ME, 0o700)}


def refusal(monkeypatch, levels: dict[str, tuple[int, int]]) -> str | None:
    """What `folder.refusal` says of the last level when the file system looks like that."""
    monkeypatch.setattr(os, "getuid", lambda: ME)

    def stat(self, **_):
        owner, mode = levels[str(self)]
        return SimpleNamespace(st_uid=owner, st_mode=0o040000 | mode)

    monkeypatch.setattr(Path, "stat", stat)
    return folder.refusal(Path(list(levels)[-1]))


@pytest.mark.parametrize("levels", [HOME, TEMPORARY, {**HOME, "/home/me": (ME, 0o755)}])
def test_a_folder_of_this_user_is_trusted(monkeypatch, levels):
    assert refusal(monkeypatch, levels) is None


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ({**HOME, "/home/me/c": (OTHER, 0o700)}, "/home/me/c belongs to user 1001"),
        ({**HOME, "/home/me/c": (0, 0o755)}, "/home/me/c belongs to user 0"),
        ({**HOME, "/home": (OTHER, 0o755)}, "/home belongs to user 1001"),
        ({**HOME, "/home/me": (ME, 0o777)}, "/home/me can be written by others"),
        ({**HOME, "/home/me": (ME, 0o770)}, "/home/me can be written by others"),
        ({**HOME, "/home/me/c": (ME, 0o1777)}, "/home/me/c can be written by others"),
        ({**TEMPORARY, "/tmp": (0, 0o777)}, "/tmp can be written by others"),
        ({**TEMPORARY, "/tmp": (OTHER, 0o1777)}, "/tmp belongs to user 1001"),
        ({**TEMPORARY, "/": (0, 0o777)}, "/ can be written by others"),
    ],
)
def test_whoever_else_could_write_is_named(monkeypatch, levels, message):
    assert refusal(monkeypatch, levels) == message


def test_the_first_trusted_folder_is_taken(monkeypatch, tmp_path):
    places = [tmp_path / name for name in ("first", "second", "third")]
    monkeypatch.setattr(folder, "candidates", lambda: iter(places))
    real = folder.refusal
    monkeypatch.setattr(folder, "refusal", lambda path: "no" if path == places[0] else real(path))
    assert folder.cache_root.__wrapped__() == places[1].resolve()
    assert places[1].stat().st_mode & 0o777 == 0o700
    assert not places[2].exists()


def test_the_package_of_another_user_is_not_a_place(monkeypatch):
    package = Path(folder.__file__).parents[1]
    assert package / "__pycache__" / "compiled" in set(folder.candidates())
    monkeypatch.setattr(os, "getuid", lambda: package.stat().st_uid + 1)
    assert not any(package in place.parents for place in folder.candidates())


def test_only_versions_that_nobody_uses_are_removed(tmp_path):
    now = time.time()
    ages = {"old-1": 40.0, "used-1": 29.0, "new-1": 0.0}
    for name, days in ages.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "code").write_text("")
        os.utime(tmp_path / name, (now - days * 86_400.0,) * 2)
    folder.version_folder(tmp_path, "used-1")  # a process reads it: marked
    assert now - (tmp_path / "used-1").stat().st_mtime < 60.0
    assert (tmp_path / "old-1").exists()
    folder.version_folder(tmp_path, "newest-1")
    assert {path.name for path in tmp_path.iterdir()} == {"used-1", "new-1", "newest-1"}


def test_no_name_in_a_shared_folder_is_a_place(monkeypatch, tmp_path):
    """Others could make it first, or a link to a folder of ours whose old files would then go."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    assert not any(tmp_path in place.parents for place in folder.candidates())


@pytest.mark.parametrize("left", ["link", "open", "file"])
def test_what_others_left_in_the_folder_is_never_read(tmp_path, left):
    """A version's folder from a time when its root was open to others."""
    root, elsewhere = tmp_path / "root", tmp_path / "elsewhere"
    root.mkdir()
    elsewhere.mkdir()
    (elsewhere / "code").write_text("theirs")
    if left == "link":
        (root / "v-1").symlink_to(elsewhere)
    elif left == "file":
        (root / "v-1").write_text("theirs")
    else:
        (root / "v-1").mkdir()
        (root / "v-1" / "code").write_text("theirs")
        (root / "v-1").chmod(0o777)
    found = folder.version_folder(root, "v-1")
    assert list(found.iterdir()) == []
    assert found.stat().st_mode & 0o777 == 0o700
    assert (elsewhere / "code").exists()
