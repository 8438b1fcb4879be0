"""Small rewards of every encoder kind, and scenes for them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders import encoder
from gril_jax.encoders.ensemble import latent_size, num_members
from gril_jax.graphs.scene import scene_graph
from gril_jax.reward.latent_goal import RewardParams

CLASSES = ("goal", "robot", "star", "square")
OBJECTS = ("goal", "robot", "square", "star", "star")

CONFIGS = {
    "paper": encoder.EncoderConfig(4, width=8, rounds=1, latent=5),
    "interaction": encoder.InteractionConfig(4, width=6, distances=True),
    "ensemble": encoder.EncoderConfig(4, width=6, rounds=1, latent=3, ensemble_size=2),
    "mlp": encoder.MLPConfig(4, width=6),
    "pixel": encoder.PixelConfig(latent=7),
}


@functools.cache
def made(config):
    """Parameters drawn with NumPy: no time is spent on compiling an initialiser."""
    rng = np.random.default_rng(0)

    def draw(shape):
        return jnp.asarray(rng.normal(size=shape) * 0.1, jnp.float32)

    shapes = jax.eval_shape(lambda key: encoder.init(key, config), jax.random.key(0))
    params = jax.tree.map(lambda leaf: draw(leaf.shape), shapes)
    if "statistics" in params:  # of a variance
        params["statistics"] = jax.tree.map(jnp.abs, params["statistics"])
    goal, scale = draw((latent_size(config),)), jnp.float32(0.7)
    if num_members(config) > 1:
        scale = jnp.linspace(0.7, 0.9, num_members(config))
    return RewardParams(params, goal, scale, jnp.float32(5.0))


def boxes(num_frames, num_nodes=5, seed=0):
    """Centres and sizes (T, N, 2); the last object never moves."""
    rng = np.random.default_rng(seed)
    center = rng.normal(size=(num_frames, num_nodes, 2)).astype(np.float32)
    center[:, -1] = center[:1, -1]
    size = rng.uniform(0.1, 0.3, size=(1, num_nodes, 2)).astype(np.float32)
    return jnp.asarray(center), jnp.asarray(np.tile(size, (num_frames, 1, 1)))


def scene(num_demos, num_frames):
    """The first five fields of a `DemoBatch`."""
    center, size = (jnp.stack([x] * num_demos) for x in boxes(num_frames))
    label = jnp.tile(jnp.array([CLASSES.index(name) for name in OBJECTS]), (num_demos, 1))
    return center, size, label, label == 1, jnp.ones_like(label, bool)


def moment(config):
    """Input of the encoder at one moment: a graph or a picture."""
    if isinstance(config, encoder.PixelConfig):
        return jax.random.uniform(jax.random.key(1), (32, 32, 3))
    center, size, label, is_robot, present = (x[0] for x in scene(1, 1))
    active = jnp.array([False, True, True, False, False])
    return scene_graph(center[0], size[0], label, is_robot, active, present)
