"""The benchmark of losses: figures of each side, and the names of peers that are missing."""

import gril_jax.experiments.bench.losses as bench
import pytest


def test_peers_that_are_not_installed_are_named(monkeypatch, capsys):
    monkeypatch.setattr(bench, "ott_costs", None)
    monkeypatch.setattr(bench, "_njit_soft_dtw_batch", None)
    monkeypatch.setattr(bench, "_COMPILATIONS", 1)
    monkeypatch.setattr(bench, "_SIZE", (2, 4, 3))
    found = bench.main([(2, 8)], repeats=1)
    assert found["not_installed"] == ["ott-jax", "tslearn"]
    (case,) = found["soft_dtw"]
    assert case["ms"]["ours"] > 0
    values = [found["tcc"][name]["value"] for name in ("pair_loop", "mapped")]
    assert values == pytest.approx([values[0]] * 2, rel=1e-4)
    assert "losses" in capsys.readouterr().err
