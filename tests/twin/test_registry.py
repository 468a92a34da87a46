"""Registries: kinds of the package, of installed packages and of files that users name."""

from __future__ import annotations

import dataclasses
from importlib import metadata
from pathlib import Path

import pytest

import twin.plugins
from twin.errors import InputError
from twin.plugins import PLUGINS
from twin.registry import Registry


@dataclasses.dataclass(frozen=True)
class Buoy:
    name: str


MOORED = Buoy("moored")
SPAR = Buoy("spar")


def check_buoy(name: str, kind: object) -> Buoy:
    if not isinstance(kind, Buoy):
        raise InputError(f"buoy {name!r} is no Buoy")
    return kind


@pytest.fixture
def buoys() -> Registry[Buoy]:
    registry = Registry("buoy", group="tests.buoys", check=check_buoy)
    registry.add(MOORED)
    return registry


def test_names_keep_their_order_and_wrong_ones_get_the_nearest(buoys: Registry[Buoy]) -> None:
    assert buoys.add(SPAR) is SPAR
    assert list(buoys) == ["moored", "spar"]
    assert buoys["spar"] is SPAR
    assert "moord" not in buoys
    with pytest.raises(InputError, match="unknown buoy 'moord': did you mean 'moored'"):
        buoys["moord"]


def test_another_class_and_a_taken_name_are_refused(buoys: Registry[Buoy]) -> None:
    with pytest.raises(InputError, match="buoy 'spar' is no Buoy"):
        buoys.register("spar", "spar")
    with pytest.raises(InputError, match="cannot be registered as a buoy: it has no name"):
        buoys.add("spar")
    with pytest.raises(InputError, match="buoy 'moored' exists already"):
        buoys.add(Buoy("moored"))
    buoys.add(SPAR)
    buoys.unregister("spar")
    assert "spar" not in buoys


def test_entry_points_are_loaded_when_they_are_asked_for(
    buoys: Registry[Buoy], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [
        metadata.EntryPoint(name, value, "tests.buoys")
        for name, value in (
            ("spar", f"{__name__}:SPAR"),
            ("gone", "no_such_module:BUOY"),
        )
    ]
    monkeypatch.setattr(metadata, "entry_points", lambda group: found)
    assert buoys.names() == ("moored", "spar", "gone")
    assert buoys["spar"].name == "spar"
    with pytest.raises(InputError, match=r"buoy 'gone' as no_such_module:BUOY, which cannot be"):
        buoys["gone"]


def test_files_in_the_environment_run_once(
    buoys: Registry[Buoy], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = tmp_path / "count.txt"
    plugin = tmp_path / "mine.py"
    plugin.write_text(f"with open({str(count)!r}, 'a') as file:\n    file.write('x')\n")
    monkeypatch.setenv(PLUGINS, str(plugin))
    assert len(buoys) == 1
    assert "moored" in buoys
    assert count.read_text() == "x"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.py", None, "names .*none.py, which is not a file"),
        ("broken.py", "1 / 0", "broken.py .*fails: ZeroDivisionError"),
        ("notes.txt", "hello", "notes.txt, which is not a Python file"),
    ],
)
def test_a_plugin_that_fails_is_named(
    buoys: Registry[Buoy],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    text: str | None,
    message: str,
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    monkeypatch.setenv(PLUGINS, str(tmp_path / name))
    with pytest.raises(InputError, match=message):
        buoys.names()
    assert str(tmp_path / name) not in twin.plugins._plugins_ran
