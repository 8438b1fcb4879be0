"""Heads that predict progress from latents: what the methods of other papers add to an encoder.

    head = heads.of("rewind").init(key, 32)                    # the method's name in `ALIGNMENTS`
    value = head.loss(key, clip)                               # of one video
    progress = head.progress(latent, start, goal)

A method is one file: a NamedTuple of arrays with the three functions of `Head`. Shapes use F for
the frames of a clip and D for the latent.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import jax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.tables import ALIGNMENTS, alternatives, find
from gril_jax.errors import ConfigError


class Clip(NamedTuple):
    """Frames of one video, in the order in which they are played."""

    latents: Float[Array, "F D"]
    frames: Int[Array, "F"]  # indices in the video, which fall where it is played backwards
    length: Int[Array, ""]  # frames of the video
    valid: Bool[Array, "F"]  # False for padding
    stages: Float[Array, "F"] | None = None  # stages finished, and the share of the present one


@runtime_checkable
class Head(Protocol):
    """A method's parameters, as a NamedTuple of arrays."""

    @classmethod
    def init(cls, key: PRNGKeyArray, latent: int) -> "Head":
        """Initial parameters for latents of a size. The key is consumed."""

    def loss(self, key: PRNGKeyArray, clip: Clip) -> Float[Array, ""]:
        """The loss of one video; 0 if the clip has nothing to learn from. The key is consumed."""

    def progress(
        self, latent: Float[Array, "*batch D"], start: Float[Array, "D"], goal: Float[Array, "D"]
    ) -> Float[Array, "*batch"]:
        """The progress of latents, given the mean latents of first and of last frames."""


def of(method: str) -> type[Head]:
    """The head of a method; a ConfigError if no method of this name has one."""
    heads = {name: one.head for name, one in ALIGNMENTS.items() if one.head}
    if method not in heads:
        raise ConfigError(f"head is {method!r:.60}; it must be {alternatives([*heads])}.")
    return find(heads[method])


def name_of(head: Head) -> str:
    """The name of a head's method."""
    return next(n for n, one in ALIGNMENTS.items() if one.head and find(one.head) is type(head))


def kernel(key: PRNGKeyArray, inputs: int, outputs: int) -> Float[Array, "inputs outputs"]:
    """Initial weights of a linear layer (LeCun). The key is consumed."""
    return jax.nn.initializers.lecun_normal()(key, (inputs, outputs))
