"""A ResNet-18's parameters under torchvision's names and in its layouts, channels first."""

import jax
import numpy as np

_FIELDS = {"scale": "weight", "bias": "bias", "mean": "running_mean", "var": "running_var"}


def weights(params):
    """Name to array: layer2_0/downsample_1/var is layer2.0.downsample.1.running_var."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(params)
    return {_name(path): _turned(np.asarray(x)) for path, x in leaves}


def _name(key_path):
    _, *parts, field = (key.key for key in key_path)
    parts = [part for part in parts if part != "trunk"]
    return ".".join([*parts, _FIELDS.get(field, "weight")]).replace("_0", ".0").replace("_1", ".1")


def _turned(x):
    return x.transpose(3, 2, 0, 1) if x.ndim == 4 else x.T
