"""Compiled functions: one for compiled code, one for Python, made when they are first used."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import uuid

from twin.compiled import folder, inline, jit


@jit
def half(x):
    return 0.5 * x


@inline
def twice(x):
    return x + x


@jit
def thrice(x):
    return twice(x) + 2.0 * half(x)


@jit
def third(x):
    return x / 3.0


@inline
def negative(x):
    return -x


@jit
def falling(x):
    return negative(third(x))


def test_what_only_compiled_code_calls_has_no_way_in_for_python():
    assert falling(1.5) == -0.5
    for function in (third, negative):
        assert function._called is None
        assert function._numba_type_ is not None  # a second process finds `falling` compiled
        assert function._inner.targetoptions["no_cpython_wrapper"]
    assert falling._inner is None


def test_python_can_call_it_all_the_same():
    assert thrice(1.0) == 3.0
    assert (half(3.0), twice(3.0)) == (1.5, 6.0)
    assert half._called is half.dispatcher is not half._inner
    assert thrice(2.0) == 6.0


def test_both_are_kept_and_not_mixed_up(tmp_path):
    """The one without a way in would end the process that calls it."""
    name = f"module_{uuid.uuid4().hex}"
    module = tmp_path / f"{name}.py"
    module.write_text(
        "from twin.compiled import jit\n\n@jit\ndef low(x):\n    return x + x\n\n"
        "@jit\ndef high(x):\n    return 3.0 * low(x)\n"
    )
    os.utime(module, (1e9, 1e9))  # what was written after the process began is not kept
    show = "print(value, [sum(f.stats.cache_hits.values()) for f in {0}])"
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])

    def run(calls: str, asked: str) -> str:
        script = f"from {name} import high, low; value = {calls}; " + show.format(asked)
        words = [sys.executable, "-c", script]
        environment = {**os.environ, "PYTHONPATH": path}
        return subprocess.run(
            words, env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert run("high(1.0)", "[high.dispatcher]") == "6.0 [0]"
    assert run("low(1.0)", "[low.dispatcher]") == "2.0 [0]"
    both = "[high.dispatcher, low.dispatcher]"
    assert run("high(1.0) + low(1.0)", both) == "8.0 [1, 1]"


def test_the_first_compiling_of_all_says_so_once(monkeypatch, caplog, tmp_path):
    monkeypatch.setattr(folder, "candidates", lambda: iter([tmp_path / "kept"]))
    monkeypatch.setattr(folder._seldom, "first", False)
    folder.cache_root.__wrapped__()
    assert folder._seldom.first
    with caplog.at_level(logging.WARNING):
        assert jit(lambda x: x - 1.0)(3.0) == 2.0
        assert jit(lambda x: x - 2.0)(3.0) == 1.0
    assert [record.getMessage() for record in caplog.records] == [folder.FIRST]
    (tmp_path / "kept" / "version").mkdir()
    folder.cache_root.__wrapped__()
    assert not folder._seldom.first
