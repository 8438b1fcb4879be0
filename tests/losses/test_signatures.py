"""Losses say in their signatures which options they take."""

import inspect

import pytest

from gril_jax import losses

NAMES = [name for name in losses.__all__ if inspect.isfunction(getattr(losses, name))]


@pytest.mark.parametrize("name", NAMES)
def test_options_are_spelled_out(name):
    parameters = inspect.signature(getattr(losses, name)).parameters.values()
    assert not [p.name for p in parameters if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]


def test_an_option_has_one_default_in_all_losses():
    found = {}
    for name in NAMES:
        for one in inspect.signature(getattr(losses, name)).parameters.values():
            if one.kind is one.KEYWORD_ONLY and one.name not in ("at_once", "num_cycles"):
                found.setdefault(one.name, set()).add(one.default)
    assert {"temperature", "form", "huber_delta", "gamma", "band"} <= found.keys()
    assert {name: values for name, values in found.items() if len(values) > 1} == {}
