"""Weights files of the pixel encoder: one .npz with torchvision's names and layouts.

The names are those of torchvision's ResNet-18, so a file of its ImageNet weights is one line:

    np.savez(path, **{k: v.numpy() for k, v in resnet18(weights=...).state_dict().items()})

    conv1.weight (64, 3, 7, 7), bn1.{weight, bias, running_mean, running_var} (64,)
    layerS.B.convI.weight (out, in, 3, 3) and layerS.B.bnI.*: stage S 1-4, block B 0-1, I 1-2
    layerS.0.downsample.0.weight (out, in, 1, 1), layerS.0.downsample.1.*: S 2-4
    head.weight (latent, 512), head.bias (latent,): ours; both may be missing

Convolutions are (out, in, height, width) there and (height, width, in, out) here. Other names,
such as torchvision's classifier `fc.*` and `num_batches_tracked`, are ignored.
"""

import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from .errors import ConfigError, ShapeError
from .message_passing import Params
from .pixel_encoder import PixelConfig

__all__ = ["load", "save"]

_FIELDS = {"scale": "weight", "bias": "bias", "mean": "running_mean", "var": "running_var"}


def load(path: str | Path, params: Params, config: PixelConfig) -> Params:
    """`params` with the trunk, and the head if the file has one, from a weights file.

    Args:
      path: an .npz file.
      params: from `pixel_encoder.init`; a head that the file lacks is kept from it.
      config: of `params`.

    Raises:
      ConfigError: the file cannot be read, or an array is missing or not finite.
      ShapeError: an array has another shape than the network's.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path} cannot be read as an .npz file of weights: {error}") from error
    whole_head = {"head.weight", "head.bias"} <= arrays.keys()

    def replaced(key_path, old):
        name = _name(key_path)
        if name.startswith("head.") and not whole_head:
            return old
        if name not in arrays:
            raise ConfigError(f"{path} has no array {name!r}; it must be a ResNet-18's weights.")
        new = arrays[name]
        if new.ndim == old.ndim:
            new = _turned_in(new)
        if new.shape != old.shape:
            raise ShapeError(
                f"{path}: {name} has shape {arrays[name].shape}; with encoder.latent "
                f"{config.latent} it must be {_turned_out(np.empty(old.shape)).shape}."
            )
        if not (np.issubdtype(new.dtype, np.floating) and np.isfinite(new).all()):
            raise ConfigError(f"{path}: {name} must be finite floating-point numbers.")
        return jnp.asarray(new, old.dtype)

    return jax.tree_util.tree_map_with_path(replaced, params)


def save(path: str | Path, params: Params) -> None:
    """Write trunk, statistics and head as `load` reads them."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(params)
    with open(path, "wb") as file:  # np.savez would add a suffix to a name without one
        np.savez(file, **{_name(p): _turned_out(np.asarray(x)) for p, x in leaves})


def _name(key_path):
    """A leaf's name in the file: layer2_0/downsample_1/var -> layer2.0.downsample.1.running_var."""
    _, *parts, field = (key.key for key in key_path)
    parts = [part for part in parts if part != "trunk"]
    return ".".join([*parts, _FIELDS.get(field, "weight")]).replace("_0", ".0").replace("_1", ".1")


def _turned_in(x):
    """From torch's layout: (out, in, h, w) -> (h, w, in, out), (out, in) -> (in, out)."""
    return x.transpose(2, 3, 1, 0) if x.ndim == 4 else x.T


def _turned_out(x):
    return x.transpose(3, 2, 0, 1) if x.ndim == 4 else x.T
