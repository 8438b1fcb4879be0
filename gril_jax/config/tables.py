"""Rules for the fields of configurations and of verbs, and tables of choices by name.

Entries of the tables name code by its path, since a command line is read before JAX is loaded.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from gril_jax.errors import ConfigError

LARGEST = 2**20  # of a size or a length in a file, which its reader would build


def rule(holds: Callable[[Any], bool], text: str) -> dict[str, Any]:
    """Field metadata: a predicate on the value, and its description after "must be"."""
    return {"holds": holds, "text": text}


def at_least(low: int | float) -> dict[str, Any]:
    """Rule for a number that is not below a limit."""
    return rule(lambda x: low <= x < float("inf"), f"finite and at least {low}")


def above(low: int | float) -> dict[str, Any]:
    """Rule for a number that is above a limit."""
    return rule(lambda x: low < x < float("inf"), f"finite and above {low}")


def between(low: int | float, high: int | float) -> dict[str, Any]:
    """Rule for a number from one limit to another, both included."""
    return rule(lambda x: low <= x <= high, f"from {low} to {high}")


def count() -> dict[str, Any]:
    """Rule for a whole number of at least 1."""
    return rule(lambda x: x >= 1, "at least 1")


def optional(metadata: dict[str, Any]) -> dict[str, Any]:
    """The same rule for a value that may also be None."""
    return rule(lambda x: x is None or metadata["holds"](x), metadata["text"])


def require(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    """Raises ConfigError if a value breaks the rule of its field."""
    if metadata and not metadata["holds"](value):
        shown = list(value) if isinstance(value, tuple) else value
        raise ConfigError(f"{name} is {shown!r}, but must be {metadata['text']}")


def fits(value: Any, kind: Any) -> bool:
    """True for a value out of JSON that a field of this type may have; lists count as tuples.

    >>> fits(["a"], tuple[str, ...]), fits(1, float | None), fits(True, int), fits("b", int | None)
    (True, True, False, False)
    """
    if get_origin(kind) is Annotated:
        return fits(value, get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return any(fits(value, one) for one in get_args(kind))
    if get_origin(kind) is Literal:
        return isinstance(value, str) and value in get_args(kind)
    if get_origin(kind) is tuple:  # of any length
        few = isinstance(value, list | tuple) and len(value) <= LARGEST
        return few and all(fits(one, get_args(kind)[0]) for one in value)
    if kind is NoneType:
        return value is None
    return type(value) is kind or (kind is float and type(value) is int)


class Encoder(NamedTuple):
    """A network from a scene graph, or from a picture, to a latent."""

    config: str
    """Its static choices, whose `of(options, num_classes)` takes them from the section `encoder`;
    `init` and `apply` are functions of the same module. It has `latent`; one of scene graphs also
    has `num_classes`, `width`, `pool_robot` and `length_unit`, which the decoders read."""
    boxes: bool = True
    """Takes scene graphs; if not, pictures."""
    nodes: bool = False
    """Embeds each node: the module has `node_embeddings` and `readout`, and no `apply`."""
    ensembles: bool = False
    """May have several members."""
    even: bool = False
    """Has a width that is even."""
    saved: str | None = None
    """The name in files of a reward, where that is another one."""


class Alignment(NamedTuple):
    """A loss that aligns videos in time, or a method that predicts progress."""

    losses: tuple[str, ...]
    """Functions as `gril_jax.pretraining.loss` has them; several are summed."""
    form: str = "regression_mse"
    """Form of the cycle-consistency that they are given."""
    similarity: str = "l2"
    """Similarity of two latents in it."""
    head: str | None = None
    """A `gril_jax.losses.heads.Head`, whose progress is the reward in place of a distance."""
    stages: bool = False
    """The head learns from stages of the demonstrations (`gril_jax.pretraining.stages`)."""


class Reward(NamedTuple):
    """A form of the reward, which a policy can maximise."""

    form: str
    """A `gril_jax.workflows.build.policy_rewards.RewardForm`."""
    learns: bool = True
    """Takes a learned reward."""
    pictures: bool = False
    """Does as well with an encoder of pictures."""
    staged: bool = False
    """Tells a policy how many stages are finished, in which sub-policies act."""


class Algorithm(NamedTuple):
    """An algorithm that trains a policy."""

    algorithm: str
    """A `gril_jax.rl.training.Algorithm` of an environment, a reward and its `Static`; with the
    types of its options as `Static` and `Hyper`."""
    options: str
    """The type of its section of the configuration, which has its name."""


ENCODERS = {
    "paper": Encoder("gril_jax.encoders.message_passing.EncoderConfig", nodes=True, ensembles=True),
    "interaction": Encoder("gril_jax.encoders.interaction_network.InteractionConfig", nodes=True),
    "mlp": Encoder("gril_jax.encoders.box_mlp.MLPConfig", even=True),
    "pixels": Encoder("gril_jax.encoders.resnet.PixelConfig", boxes=False, saved="pixel"),
}

_CYCLE = ("gril_jax.pretraining.loss.cycle",)
_WARPING = ("gril_jax.pretraining.loss.warping",)
_HEAD = ("gril_jax.pretraining.loss.of_head",)
ALIGNMENTS = {
    "tcc": Alignment(_CYCLE),
    "tcc_variance": Alignment(_CYCLE, form="regression_mse_var"),
    "tcc_huber": Alignment(_CYCLE, form="regression_huber"),
    "tcc_classification": Alignment(_CYCLE, form="classification"),
    "tcc_stochastic": Alignment(("gril_jax.pretraining.loss.sampled_cycle",)),
    "tcc_cosine": Alignment(_CYCLE, similarity="cosine"),
    "soft_dtw": Alignment(_WARPING),
    "both": Alignment(_CYCLE + _WARPING),
    "timerewarder": Alignment(_HEAD, head="gril_jax.losses.timerewarder.TimeRewarder"),
    "rewind": Alignment(_HEAD, head="gril_jax.losses.rewind.ReWiND"),
    "sarm": Alignment(_HEAD, head="gril_jax.losses.sarm.SARM", stages=True),
    "progressor": Alignment(_HEAD, head="gril_jax.losses.progressor.PROGRESSOR"),
}

_FORMS = "gril_jax.workflows.build.policy_rewards"
REWARDS = {
    "learned": Reward(f"{_FORMS}.LEARNED", pictures=True),
    "environmental": Reward(f"{_FORMS}.ENVIRONMENTAL", learns=False, pictures=True),
    "stages": Reward(f"{_FORMS}.STAGES", staged=True),
    "shaped": Reward(f"{_FORMS}.SHAPED"),
}

ALGORITHMS = {
    "ppo": Algorithm("gril_jax.rl.ppo.PPO", "gril_jax.config.policy.PPOConfig"),
    "sac": Algorithm("gril_jax.rl.sac.SAC", "gril_jax.config.policy.SACConfig"),
}


def find(path: str) -> Any:
    """The object at a path of a table, imported now."""
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


def alternatives(names: list[str]) -> str:
    """Names as a choice in words.

    >>> alternatives(["a", "b", "c"])
    "'a', 'b' or 'c'"
    """
    quoted = [repr(name) for name in names]
    return " or ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))
