"""The README's Python runs as it stands there."""

import re

import jax
import jax.numpy as jnp
from support.paths import REPOSITORY

from gril_jax import reward
from gril_jax.encoders import encoder

README = (REPOSITORY / "README.md").read_text()


def _snippets():
    return re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_the_reward_is_used_in_three_lines():
    config = encoder.EncoderConfig(num_classes=3, width=8, latent=4)
    params = encoder.init(jax.random.key(0), config)
    names = {
        "center": jnp.zeros((3, 2)),
        "size": jnp.ones((3, 2)),
        "label": jnp.arange(3),
        "is_robot": jnp.array([True, False, False]),
        "active": jnp.zeros(3, bool),
        "config": config,
        "params": reward.RewardParams(params, jnp.zeros(4), jnp.ones(()), jnp.full((), 5.0)),
    }
    exec(_snippets()[0], names)
    assert names["r"].shape == ()
    assert float(names["r"]) <= 0


def test_the_losses_are_called_as_shown():
    x, y = jax.random.normal(jax.random.key(0), (2, 3, 5, 4))
    names = {
        "x": x,
        "y": y,
        "cost": jax.random.uniform(jax.random.key(1), (3, 5, 6)),
        "latents": jax.random.normal(jax.random.key(2), (3, 5, 4)),
        "times": jnp.tile(jnp.linspace(0.0, 1.0, 5), (3, 1)),
    }
    exec(_snippets()[1], names)
    assert names["value"].shape == (3,)
    assert names["alignment"].shape == (3, 5, 6)
    assert names["path"].shape == (10, 2)
    assert names["loss"].shape == ()
