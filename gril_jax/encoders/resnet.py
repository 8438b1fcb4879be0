"""XIRL's pixel encoder (Zakka et al., CoRL 2021): ResNet-18, mean over the image, a linear head.

The trunk is that of He et al. (CVPR 2016) as torchvision builds it, 11,176,512 parameters; the
head has 512 x 32 + 32. Frames are RGB in [0, 1], without normalisation by ImageNet's mean. Shapes
use B or V for videos, T or F for their frames, P for a frame's side and D for the latent. Frames
may have any leading axes, such as (B, T), and any size (XIRL: 112).

Batch normalisation makes training differ from use. `apply` normalises every frame by running
statistics. `apply_train` normalises by the statistics of the frames it is given, and returns
parameters with updated running statistics. For use with `gril_jax.encoders.encoder`.

With `precision="bfloat16"` (mixed precision; Micikevicius et al., ICLR 2018) the trunk's
activations and convolutions are of 16 bits. Parameters, gradients, running statistics, the
normalisations' arithmetic, the mean over the image, head and latent are float32 all the same.
"""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray, UInt8

from gril_jax.config.encoder import EncoderOptions
from gril_jax.errors import ConfigError, ShapeError, require_at_least

from .message_passing import Params

# Channels and first stride of the four stages, each of two blocks of two 3 x 3 convolutions.
STAGES = ((64, 1), (128, 2), (256, 2), (512, 2))


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class PixelConfig:
    """Static options: changing one recompiles. A pytree without leaves."""

    latent: int = EncoderOptions.latent
    """Size of the latent."""
    pixels: int | None = None
    """Width and height of the frames that it is trained and used with; None takes any."""
    precision: Literal["float32", "bfloat16"] = EncoderOptions.precision
    """Precision of the trunk's activations and convolutions, not of the parameters."""

    def __post_init__(self):
        require_at_least(self, "encoder", latent=1)
        if self.pixels is not None and self.pixels < 1:
            raise ConfigError(f"encoder.pixels is {self.pixels}; it must be at least 1, or None.")

    @classmethod
    def of(cls, options: EncoderOptions, num_classes: int) -> "PixelConfig":
        """From the section `encoder` of a run's configuration."""
        del num_classes
        return cls(options.latent, pixels=options.pixels, precision=options.precision)


def turn(key: PRNGKeyArray, frames: UInt8[Array, "V F P P 3"]) -> UInt8[Array, "V F P P 3"]:
    """Applies a random symmetry of the square to each video, the same to all of its frames.

    The same symmetries as `gril_jax.pretraining.batch.turn` draws for boxes from the same key. The
    key is consumed.
    """
    sign_key, swap_key = jax.random.split(key)
    num = frames.shape[0]
    sign = jax.random.rademacher(sign_key, (num, 1, 1, 2), dtype=jnp.float32)[..., None, None]
    swap = jax.random.bernoulli(swap_key, shape=(num, 1, 1, 1))[..., None]
    # x and y swapped: mirrored at the diagonal that rises to the right.
    frames = jnp.where(swap, frames.swapaxes(2, 3)[:, :, ::-1, ::-1], frames)
    frames = jnp.where(sign[:, :, :, 0] < 0, frames[:, :, :, ::-1], frames)
    return jnp.where(sign[:, :, :, 1] < 0, frames[:, :, ::-1], frames)


def init(key: PRNGKeyArray, config: PixelConfig) -> Params:
    """Initial random parameters. The key is consumed.

    Returns:
      A dict of `weights` (those of `trunk` and `head`) and `statistics`, the running mean and
      variance of each normalisation. Gradients of `statistics` are zero, so an optimiser without
      weight decay leaves them alone.
    """
    made = _Network(config).init(key, jnp.zeros((1, 32, 32, 3)), train=False)
    return {"weights": made["params"], "statistics": made["batch_stats"]["trunk"]}


def apply(
    params: Params, frames: Float[Array, "*batch height width 3"], config: PixelConfig
) -> Float[Array, "*batch D"]:
    """Latents of frames with the running statistics, so that each depends on its frame alone.

    Raises:
      ShapeError: `frames` is not floating, not of shape (..., height, width, 3), or not of the
        config's size.
    """
    flat = _flat(frames, config)
    latents = _Network(config).apply(_variables(params), flat, train=False)
    return latents.reshape(*frames.shape[:-3], config.latent)


def apply_train(
    params: Params, frames: Float[Array, "*batch height width 3"], config: PixelConfig
) -> tuple[Float[Array, "*batch D"], Params]:
    """Latents normalised over all frames given, as one batch of B * T.

    Returns:
      Latents, and `params` with the statistics moved a tenth of the way to those of these frames.

    Raises:
      ShapeError: `frames` is not floating, not of shape (..., height, width, 3), or not of the
        config's size.
    """
    latents, moved = _Network(config).apply(
        _variables(params), _flat(frames, config), train=True, mutable=["batch_stats"]
    )
    statistics = jax.lax.stop_gradient(moved["batch_stats"]["trunk"])
    latents = latents.reshape(*frames.shape[:-3], config.latent)
    return latents, {**params, "statistics": statistics}


def floats(frames: UInt8[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Converts frames of 8 bits a channel to the encoder's input.

    >>> [round(x, 3) for x in floats(jnp.array([0, 51, 255], jnp.uint8)).tolist()]
    [0.0, 0.2, 1.0]
    """
    return frames.astype(jnp.float32) / 255.0


def _variables(params):
    statistics = jax.lax.stop_gradient(params["statistics"])
    return {"params": params["weights"], "batch_stats": {"trunk": statistics}}


def _flat(frames, config):
    shape = frames.shape
    if len(shape) < 3 or shape[-1] != 3 or 0 in shape:
        raise ShapeError(
            f"frames has shape {shape}; it must be (..., height, width, 3), and not empty."
        )
    if config.pixels is not None and shape[-3:-1] != (config.pixels,) * 2:
        raise ShapeError(
            f"frames has shape {shape}; with encoder.pixels {config.pixels} height and width must "
            f"be {config.pixels}."
        )
    if not jnp.issubdtype(frames.dtype, jnp.floating):
        raise ShapeError(f"frames has type {frames.dtype}; it must be floating, RGB in [0, 1].")
    return frames.reshape(-1, *shape[-3:])


class _Network(nn.Module):
    config: PixelConfig

    @nn.compact
    def __call__(self, frames, *, train):
        features = _Trunk(self.config.precision, name="trunk")(frames, train=train)
        return nn.Dense(self.config.latent, name="head")(features)


class _Trunk(nn.Module):
    precision: str = "float32"

    @nn.compact
    def __call__(self, x, *, train):
        dtype = jnp.dtype(self.precision)
        x = _conv(64, 7, 2, dtype, "conv1")(x)
        x = nn.relu(_norm(train, dtype, "bn1")(x))
        x = nn.max_pool(x, (3, 3), strides=(2, 2), padding=((1, 1), (1, 1)))
        for stage, (channels, stride) in enumerate(STAGES, start=1):
            for block in range(2):
                name = f"layer{stage}_{block}"
                x = _Block(channels, 1 if block else stride, dtype, name=name)(x, train=train)
        return jnp.mean(x.astype(jnp.float32), axis=(1, 2))


class _Block(nn.Module):
    channels: int
    stride: int
    dtype: jnp.dtype

    @nn.compact
    def __call__(self, x, *, train):
        y = _conv(self.channels, 3, self.stride, self.dtype, "conv1")(x)
        y = nn.relu(_norm(train, self.dtype, "bn1")(y))
        y = _conv(self.channels, 3, 1, self.dtype, "conv2")(y)
        y = _norm(train, self.dtype, "bn2")(y)
        if x.shape != y.shape:
            x = _conv(self.channels, 1, self.stride, self.dtype, "downsample_0")(x)
            x = _norm(train, self.dtype, "downsample_1")(x)
        return nn.relu(x + y)


def _conv(channels, size, stride, dtype, name):
    """Explicitly padded convolution: "SAME" pads strided images differently from torchvision."""
    return nn.Conv(
        channels, (size, size), strides=stride, padding=size // 2, use_bias=False, dtype=dtype,
        kernel_init=nn.initializers.variance_scaling(2.0, "fan_out", "normal"), name=name,
    )  # fmt: skip


def _norm(train, dtype, name):
    """Normalisation computed in float32, for any type of input and output."""
    return nn.BatchNorm(
        use_running_average=not train, momentum=0.9, epsilon=1e-5, dtype=dtype, name=name,
        use_fast_variance=False,  # the fast one loses the variance of a channel far from zero
    )  # fmt: skip
