"""The encoders phi behind one interface: `init(key, config)` and `apply(params, graph, config)`.

    config                 encoder                                        input
    `EncoderConfig`        the paper's message passing, weighted pooling  a `SceneGraph`
    `InteractionConfig`    GraphIRL's interaction network, mean pooling   a `SceneGraph`
    `MLPConfig`            GraphIRL's ablation without relations          a `SceneGraph`
    `PixelConfig`          XIRL's ResNet-18                               a frame (H, W, 3)

Graph encoders take one graph; batch with `jax.vmap`. Parameters are plain pytrees of arrays:
hold, save and vmap them without knowing the libraries underneath. An `EncoderConfig` with an
`ensemble_size` above 1 is an ensemble (`gril_jax.encoders.ensemble`): parameters have a leading
axis of members, whose latents lie side by side. Shapes use N for nodes, H for the width of a node
embedding and D for the latent.
"""

import dataclasses
import sys
import typing
from collections.abc import Mapping
from typing import Any, Union

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig
from gril_jax.config.tables import ENCODERS, LARGEST, find, fits
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import SceneGraph, checked

from .box_mlp import MLPConfig as MLPConfig
from .ensemble import latent_size, member, num_members
from .interaction_network import InteractionConfig as InteractionConfig
from .message_passing import EncoderConfig as EncoderConfig
from .message_passing import Form, Params
from .resnet import PixelConfig as PixelConfig

_KINDS = {find(one.config): one for one in ENCODERS.values()}
KINDS = {one.saved or name: find(one.config) for name, one in ENCODERS.items()}
# Encoders that embed each node before they pool; of scene graphs; of anything.
NodeConfig = Union[tuple(kind for kind, one in _KINDS.items() if one.nodes)]  # noqa: UP007
GraphConfig = Union[tuple(kind for kind, one in _KINDS.items() if one.boxes)]  # noqa: UP007
AnyConfig = Union[tuple(_KINDS)]  # noqa: UP007

# A file must not make its reader build a network without end.
_MOST = {"rounds": 100, "ensemble_size": 100}


def init(key: PRNGKeyArray, config: AnyConfig) -> Params:
    """Initial parameters: a dict of dicts of arrays. The key is consumed.

    >>> config = MLPConfig(num_classes=3, width=8)
    >>> params = init(jax.random.key(0), config)
    >>> sorted(params)
    ['agent', 'boxes', 'latent']

    Raises:
      ConfigError: there is no encoder for this kind of config.
    """
    members = num_members(config)
    if members > 1:
        one = member(config)
        return jax.vmap(lambda key: init(key, one))(jax.random.split(key, members))
    return _module(config).init(key, config)


@checked
def apply(
    params: Params,
    graph: SceneGraph | Float[Array, "... height width 3"],
    config: AnyConfig,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    form: Form = "dense",
) -> Float[Array, "... D"]:
    """The latent of one scene graph, or of frames.

    A graph's latent does not depend on the order of the nodes, nor on those that are not present.
    Whether it depends on the robot is the config's `pool_robot` and `robot_messages`.

    Args:
      params, config: from `init`, with the same config.
      graph: from `gril_jax.graphs.scene_graph`; its edge order is taken as given there. For
        `PixelConfig` RGB frames in [0, 1].
      alpha: weight of an active node in the pooling (Eq. 3); may be traced. Only the paper's
        encoder uses it.
      form: of `node_embeddings`.

    Raises:
      ConfigError: there is no encoder for this kind of config.
      ShapeError: the input does not fit the config.
    """
    if num_members(config) > 1:
        return _side_by_side(params, graph, config, alpha, form)
    if isinstance(config, NodeConfig):
        nodes = node_embeddings(params, graph, config, form=form)
        return readout(params, nodes, graph, config, alpha=alpha)
    return _module(config).apply(params, graph, config)


@checked
def node_embeddings(
    params: Params, graph: SceneGraph, config: NodeConfig, *, form: Form = "dense"
) -> Float[Array, "N H"]:
    """Embedding of each node, before pooling.

    Args:
      params, graph, config: of `apply`.
      form: how the paper's encoder sums messages; the numbers are the same. "dense" is the fastest
        forward; "square" takes less compiling, and its gradient is as fast.

    Raises:
      ConfigError: this kind of encoder does not embed nodes, or it is an ensemble.
    """
    return _node_module(config).node_embeddings(params, graph, config, form=form)


def readout(
    params: Params,
    embeddings: Float[Array, "N H"],
    graph: SceneGraph,
    config: NodeConfig,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
) -> Float[Array, "D"]:
    """The second half of `apply`: pools `node_embeddings`, then the head if there is one.

    Raises:
      ConfigError: this kind of encoder does not embed nodes, or it is an ensemble.
    """
    return _node_module(config).readout(params, embeddings, graph, config, alpha=alpha)


def sees_robot(config: AnyConfig) -> bool:
    """True if latents depend on the robot; if not, a graph may come without its nodes."""
    if not isinstance(config, NodeConfig):
        return True
    return config.pool_robot or config.robot_messages


def to_json(config: AnyConfig) -> dict[str, Any]:
    """An encoder's configuration as JSON: its `kind`, and its fields by name.

    >>> to_json(KINDS["mlp"](num_classes=3))["kind"]
    'mlp'

    Raises:
      ConfigError: there is no encoder for this kind of config.
    """
    for kind, chosen in KINDS.items():
        if type(config) is chosen:
            return {"kind": kind, **dataclasses.asdict(config)}
    raise ConfigError(
        f"config is a {type(config).__name__}; it must be one of "
        f"{', '.join(chosen.__name__ for chosen in KINDS.values())}."
    )


def from_json(about: Any) -> AnyConfig:
    """The configuration of `to_json`; missing fields take their defaults.

    >>> from_json({"kind": "pixel", "latent": 8})
    PixelConfig(latent=8, pixels=None, precision='float32')

    Raises:
      ConfigError: the kind or a field is unknown, missing, of another type or out of range.
    """
    if not isinstance(about, Mapping) or about.get("kind") not in [*KINDS]:
        kind = about.get("kind") if isinstance(about, Mapping) else about
        raise ConfigError(f"encoder.kind is {kind!r:.60}; it must be one of {', '.join(KINDS)}.")
    chosen = KINDS[about["kind"]]
    types = typing.get_type_hints(chosen)
    values = {name: value for name, value in about.items() if name != "kind"}
    for name, value in values.items():
        if name not in types:
            raise ConfigError(
                f"encoder.{name} is unknown to this version of gril-jax; a {about['kind']} encoder "
                f"has {', '.join(types)}."
            )
        if not fits(value, types[name]):
            wanted = getattr(types[name], "__name__", types[name])
            raise ConfigError(f"encoder.{name} is {value!r:.60}; it must be of type {wanted}.")
        most = _MOST.get(name, LARGEST)
        if type(value) is int and value > most:
            raise ConfigError(f"encoder.{name} is {value!r:.60}; it must be at most {most}.")
    if "num_classes" in types and "num_classes" not in values:
        raise ConfigError("encoder.num_classes is missing; it must be the number of classes.")
    return chosen(**{k: tuple(x) if isinstance(x, list) else x for k, x in values.items()})


def _side_by_side(params, graph, config, alpha, form):
    """The latents of an ensemble's members, concatenated."""
    members, one = num_members(config), member(config)
    stray = next((x for x in jax.tree.leaves(params) if x.shape[:1] != (members,)), None)
    if stray is not None:
        raise ShapeError(
            f"params has an array of shape {stray.shape}; those of an ensemble must have a leading "
            f"axis of encoder.ensemble_size, which is {members}."
        )
    each = jax.vmap(lambda p: apply(p, graph, one, alpha=alpha, form=form), out_axes=-2)(params)
    return each.reshape(*each.shape[:-2], latent_size(config))


def _module(config):
    if type(config) not in _KINDS:
        known = ", ".join(kind.__name__ for kind in _KINDS)
        raise ConfigError(f"encoder is a {type(config).__name__}; it must be one of {known}.")
    return sys.modules[type(config).__module__]


def _node_module(config):
    if type(config) in _KINDS and not _KINDS[type(config)].nodes:
        known = " or an ".join(kind.__name__ for kind, one in _KINDS.items() if one.nodes)
        raise ConfigError(
            f"encoder is a {type(config).__name__}, which does not embed nodes; it must be an "
            f"{known}."
        )
    if num_members(config) > 1:
        raise ConfigError(
            f"encoder.ensemble_size is {num_members(config)}, but must be 1 to embed nodes: each "
            "member of an ensemble has its own."
        )
    return _module(config)
