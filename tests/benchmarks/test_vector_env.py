"""The benchmarks of many vehicles run and print what they measure."""

from __future__ import annotations

import pytest

pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

from benchmarks import one_scene, vector_env


def test_rates_stand_beside_their_limit(monkeypatch, capsys):
    monkeypatch.setattr(vector_env, "ROUNDS", 1)
    monkeypatch.setattr(vector_env, "SECONDS", 0.01)
    vector_env.main(vehicles=8, lanes=9)
    head, columns, *rows = capsys.readouterr().out.splitlines()
    assert "8 vehicles" in head
    assert "9 in lanes" in head
    names = ["task", "vector", "bare", "batch", "part", "single", "times", "lanes", "us"]
    assert columns.split() == names
    assert [row.split()[0] for row in rows] == list(vector_env.ALL_TASKS)
    assert all(float(cell) > 0.0 for row in rows for cell in row.split()[1:])


def test_a_scene_has_as_many_gliders_as_asked_for():
    model = one_scene.scene(2)
    assert model.nu == 2 * one_scene.scene(1).nu
    assert one_scene.cost(model) > 0.0
