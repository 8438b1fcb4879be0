"""A small policy file."""

import inspect
import json
from pathlib import Path

import numpy as np

from gril_jax.export import read_policy
from gril_jax.export.reward_format import packed

LAYERS = ((3, 5, "swish"), (5, 4, "tanh"), (4, 4, "none"))
ABOUT = {
    "format": "gril-jax policy",
    "version": 2,
    "layers": [{"in": i, "out": o, "activation": a} for i, o, a in LAYERS],
    "output": {"mean": [0, 2], "spread": [2, 4], "squash": "tanh"},
    "reader": inspect.getsource(read_policy),
}


def arrays():
    """The arrays of the policy by name, drawn at random."""
    rng = np.random.default_rng(0)
    found = {"observation_mean": rng.normal(size=3), "observation_limit": np.full(3, 4.0)}
    for i, (inputs, outputs, _) in enumerate(LAYERS):
        found[f"kernel_{i}"] = rng.normal(size=(inputs, outputs))
        found[f"bias_{i}"] = rng.normal(size=outputs)
    return {name: array.astype(np.float32) for name, array in found.items()}


def write(path):
    """Writes the policy to a file: 3 numbers of observation, 2 of action."""
    Path(path).write_bytes(packed(arrays(), json.dumps(ABOUT)))
