"""Networks on kinds of gliders that were left out of their training: its figures."""

import numpy as np
import pytest
from examples import ROOT


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    import benchmarks.left_out_kinds

    return benchmarks.left_out_kinds


def test_the_ratio_is_of_means_of_the_same_missions(bench):
    near = np.linspace(0.2, 2.0, 40)
    each = {0: 3.0 * near, 5: 2.0 * near}
    methods = {
        "flight filter": {0: near},
        "networks of the others": each,
        "networks of the kind": {0: near, 5: near},
    }
    answer = bench.figures({"spray": methods})
    ratio = answer["spray"]["ratio"]
    assert ratio["value"] == pytest.approx(2.0)
    assert ratio["interval"] == pytest.approx((2.0, 2.0))  # paired: it is twice on every mission
    shown = answer["spray"]["methods"]["networks of the others"]["5"]
    low, high = shown["interval"]
    assert shown["dr_velocity_percent"] == pytest.approx(each[5].mean())
    assert low < each[5].mean() < high
    filtered, others, own = bench.rows(answer)
    assert "5 dives, %" not in filtered  # it does not adapt
    assert others["ratio"] == "2.00 (2.00 to 2.00)"
    assert "ratio" not in own


def test_no_kind_is_tested_on_the_seed_that_it_was_trained_on(bench):
    tiers = bench.recipes(100.0)
    assert list(tiers) == list(bench.KINDS)
    seeds = [one["seed"] for tier in tiers.values() for one in (tier.train, tier.test)]
    assert len(set(seeds)) == 2 * len(tiers)
    for kind, tier in tiers.items():
        assert tier.train["vehicle"] == tier.test["vehicle"] == kind
        assert tier.test["changes"]["vehicle.k_d0"] == "1.4"
