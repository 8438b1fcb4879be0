"""Exports a run's policy as plain arrays, for programs without JAX or this package.

`gril export RUN --what policy --out policy.npz` writes the policy that `gril eval` plays, with its
deterministic (mean) action. `gril_jax/export/read_policy.py` plays it with NumPy alone, here or
copied to a robot, and refuses a file that is damaged or edited:

    from gril_jax.export.read_policy import load_policy

    act = load_policy("policy.npz")
    action = act(observation)

A file brings that module along, as `reader` of its description:

    import json
    import numpy as np

    with np.load("policy.npz") as file:
        about = json.loads(str(file["description"]))
    with open("read_policy.py", "w", encoding="utf-8") as file:
        file.write(about["reader"])

Arrays, all float32, for O inputs and layers i of H_i outputs:
  observation_mean (O,), observation_limit (O,)   see below
  kernel_i (H_(i-1), H_i), bias_i (H_i,)
  description ()   a JSON text; `describe` lists its fields
and a digest of the whole file, its last 64 bytes (`gril_jax.export.reward_format`).

The observation is normalised by clip((x - mean) / std, -10, 10). The division is folded into
`kernel_0`; mean and limit = 10 std stay apart. For an input that hardly varies x / std and mean /
std are both large, and in float32 their difference would lose digits.
"""

import dataclasses
import inspect
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, get_type_hints, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float

from gril_jax.config import EnvConfig, MakeDemosConfig, RunConfig
from gril_jax.config.encoder import PoolConfig
from gril_jax.config.run_config import check, require_one_network
from gril_jax.config.tables import fits
from gril_jax.errors import ConfigError, GrilError, RunError, ShapeError, is_printable
from gril_jax.graphs import activity_rule
from gril_jax.graphs.activity_rule import ActivityRule
from gril_jax.rl import training
from gril_jax.rl.policy import MAX_OBSERVATION, Policy
from gril_jax.runs.reading import package_versions
from gril_jax.safe_files import new_file, writing

from . import read_policy
from .reward_format import packed

FORMAT, VERSION = "gril-jax policy", 2

_ACTIVATION = "swish"  # brax's default, which PPO and SAC keep; the last layer has none


class PolicyFileError(GrilError, ValueError):
    """A policy file is missing, damaged, or of no network that this package has."""


@runtime_checkable
class SizedTask(Protocol):
    """A task as far as a policy's file describes it."""

    observation_size: int
    action_size: int


def save(out: Path, config: RunConfig, algorithm: training.Algorithm, policy: Policy) -> None:
    """Writes a policy to a new file; its algorithm is built from its config.

    Raises:
      ConfigError: the policy is more than one plain network.
      RunError: it is not finite, or the file exists or cannot be written.
      ShapeError: the task misnames its numbers.
    """
    require_one_network(config)
    arrays = policy_arrays(policy)
    if broken := [name for name, array in arrays.items() if not np.isfinite(array).all()]:
        raise RunError(f"{broken[0]} of the policy is not finite: train it again")
    env, objects = algorithm.env, []
    if algorithm.episodes.observe_activity:
        label = jax.jit(lambda key: env.reset(key).objects.label)(jax.random.key(0))
        objects = [env.classes[i] for i in np.asarray(label)]
    write(out, arrays, describe(config, env, arrays, objects))


def policy_arrays(policy: Policy) -> dict[str, Float[np.ndarray, "..."]]:
    """The policy's float32 arrays by name; the module's text says how to use them."""
    # In float64, so that folding rounds once.
    mean, std = (np.asarray(x, np.float64) for x in (policy.normalizer.mean, policy.normalizer.std))
    arrays = {"observation_mean": mean, "observation_limit": MAX_OBSERVATION * std}
    layers = policy.params["params"]
    for i in range(len(layers)):
        kernel = np.asarray(layers[f"hidden_{i}"]["kernel"], np.float64)
        arrays[f"kernel_{i}"] = kernel / std[:, None] if i == 0 else kernel
        arrays[f"bias_{i}"] = np.asarray(layers[f"hidden_{i}"]["bias"])
    return {name: array.astype(np.float32) for name, array in arrays.items()}


def describe(
    config: RunConfig,
    env: SizedTask,
    arrays: dict[str, Float[np.ndarray, "..."]],
    objects: Sequence[str],
) -> dict[str, Any]:
    """The meaning of the arrays, as JSON has it; errors are those of `observation_layout`. Index
    ranges are [start, stop).

    The objects are those whose activity bits the policy sees, in order. Its fields:
      format, version, gril_jax: what wrote the file.
      reader: the text of `gril_jax/export/read_policy.py`, which plays the file.
      layers: `in`, `out` and `activation` (swish, relu, tanh or none) of each.
      output: the ranges of the last layer that hold the action's mean and its spread before
        `squash`, which is applied to the mean. The deterministic action does not need the spread.
      observation: name and range of each input, in order, activity bits included.
      activity: None, or the range of the activity bits, their objects, and the rule: a bit is 0
        when an episode begins and becomes 1 for good when the centre of the object's box lies more
        than `tau` box diagonals from where it was `window` control steps before. `smoothing` and
        `noise` are those of `gril_jax.graphs.activity`.
      action: name, range and limits of each number of the action.
      control_hz: actions a second.
      env: the task's settings in the run.
    """
    kernels = [array for name, array in arrays.items() if name.startswith("kernel_")]
    activations = [_ACTIVATION] * (len(kernels) - 1) + ["none"]
    num_own, size = env.observation_size, env.action_size
    activity = {
        "start": num_own,
        "stop": num_own + len(objects),
        "objects": [*objects],
        **config.pool.rule(),
    }
    return {
        "format": FORMAT,
        "version": VERSION,
        "gril_jax": package_versions()["gril-jax"],
        "layers": [
            {"in": kernel.shape[0], "out": kernel.shape[1], "activation": activation}
            for kernel, activation in zip(kernels, activations, strict=True)
        ],
        "output": {"mean": [0, size], "spread": [size, 2 * size], "squash": "tanh"},
        "observation": observation_layout(env, objects),
        "activity": activity if objects else None,
        "action": action_layout(env),
        "control_hz": float(env.control_hz),
        "env": dataclasses.asdict(config.env),
        "reader": inspect.getsource(read_policy),
    }


def observation_layout(env: SizedTask, objects: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Name, start and stop of each part of the policy's input, in order.

    The task's `observation_names`, if it has them, name each number, or it is a ShapeError; equal
    names in a row are one part. Without them there is a single part "observation". The objects'
    activity bits follow.
    """
    bits = [f"{name} has moved" for name in objects]
    return _layout(env, "observation", env.observation_size, bits)


def action_layout(env: SizedTask) -> list[dict[str, Any]]:
    """Name, start, stop, low and high of each part of the action, as `observation_layout`, whose
    errors are the same."""
    found = _layout(env, "action", env.action_size)
    return [entry | {"low": -1.0, "high": 1.0} for entry in found]


def write(
    out: Path, arrays: dict[str, Float[np.ndarray, "..."]], description: dict[str, Any]
) -> None:
    """Writes a new npz file, complete or not at all; equal contents give equal bytes."""
    contents = packed(arrays, json.dumps(description, allow_nan=False))
    with writing(out.parent):
        try:
            with new_file(out) as file:
                file.write(contents)
        except FileExistsError:
            raise RunError(f"{out} exists already: name a new file") from None


def load(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The description and the arrays of a policy file of ours; a PolicyFileError for a file that is
    missing, damaged, or not what `describe` and `policy_arrays` made."""
    try:
        about, arrays = read_policy.unpack(path)
        read_policy.load_policy(path)  # checks that layers and arrays fit together
        _check(about)
    except OSError as error:
        raise PolicyFileError(f"{path} cannot be read ({error.strerror})") from None
    except (ValueError, ConfigError) as error:
        named = "" if str(path) in str(error) else f"{path}: "
        raise PolicyFileError(f"{named}{error}") from None
    except (LookupError, TypeError, AttributeError) as error:
        why = f"{type(error).__name__}: {error!s:.60}"
        raise PolicyFileError(f"{path} is no whole policy file ({why}): export it again") from None
    return about, arrays


def env_of(about: dict[str, Any], path: Path) -> EnvConfig:
    """The task that a policy file names; a PolicyFileError if its settings are not those of one."""
    found, kinds = about["env"], get_type_hints(EnvConfig, include_extras=True)
    for name, value in found.items():
        if name not in kinds or not fits(value, kinds[name]):
            raise PolicyFileError(f"{path}: env.{name} cannot be {value!r:.60}: export it again")
    if lacks := [name for name in kinds if name not in found]:
        raise PolicyFileError(f"{path}: env.{lacks[0]} is missing: export it again")
    config = EnvConfig(**{n: tuple(x) if isinstance(x, list) else x for n, x in found.items()})
    try:
        check(MakeDemosConfig(env=config))
    except ConfigError as error:
        raise PolicyFileError(f"{path}: {error}") from None
    return config


def pool_of(activity: dict[str, Any] | None) -> PoolConfig:
    """The section of a run with the activity rule of a policy file; a ValueError without one."""
    if activity is None:
        return PoolConfig()
    given = {name: activity[name] for name in ActivityRule._fields if name in activity}
    rule = activity_rule.from_json(given)
    pool = PoolConfig(window=rule.window, noise=rule.noise)
    if ActivityRule(**pool.rule()) != rule:
        raise ValueError("the rule of activity must be one that a run can have")
    return pool


def _check(about: dict[str, Any]) -> None:
    """Raises ValueError unless the description says what this package's networks do."""
    layers, (start, stop) = about["layers"], about["output"]["mean"]
    usual = [_ACTIVATION] * (len(layers) - 1) + ["none"]
    if [layer["activation"] for layer in layers] != usual:
        raise ValueError(f"the activations must be {', '.join(usual)}")
    if about["output"] != {"mean": [0, stop], "spread": [stop, 2 * stop], "squash": "tanh"}:
        raise ValueError(f"the output must be the mean and spread of {stop - start} numbers")
    _check_parts(about["observation"], layers[0]["in"], "observation")
    _check_parts(about["action"], stop, "action")
    if any((part["low"], part["high"]) != (-1.0, 1.0) for part in about["action"]):
        raise ValueError("the action must be from -1 to 1")
    if not (fits(about["control_hz"], float) and 0 < about["control_hz"] < 1e6):
        raise ValueError("control_hz must be a number of actions a second")
    if about["activity"] is not None:
        _check_bits(about["activity"], layers[0]["in"])
    if not isinstance(about["env"], dict):
        raise ValueError("env must be the settings of the task")


def _check_bits(activity: dict[str, Any], stop: int) -> None:
    """Raises ValueError unless the activity bits are the last ones of the observation."""
    pool_of(activity)
    objects, found = activity["objects"], [activity["start"], activity["stop"]]
    if not fits(objects, tuple[str, ...]) or not objects:
        raise ValueError("the objects of activity must be a list of names")
    if not fits(found, tuple[int, ...]) or found != [stop - len(objects), stop]:
        raise ValueError("the range of activity must be the end of the observation")


def _check_parts(parts: Sequence[dict[str, Any]], size: int, what: str) -> None:
    """Raises ValueError unless named parts follow each other from 0 to the size."""
    at = 0
    for part in parts:
        whole = fits(part["start"], int) and fits(part["stop"], int)
        if not (whole and part["start"] == at < part["stop"] and is_printable(part["name"])):
            raise ValueError(f"the parts of the {what} must have names, and follow each other")
        at = part["stop"]
    if at != size:
        raise ValueError(f"the parts of the {what} are {at} numbers, but must be {size}")


def _layout(env: SizedTask, kind: str, size: int, more: Sequence[str] = ()) -> list[dict[str, Any]]:
    names = getattr(env, f"{kind}_names", [kind] * size)
    if len(names) != size:
        task = type(env).__name__
        raise ShapeError(f"{task} names {len(names)} numbers of its {kind}, but it has {size}")
    numbered = itertools.groupby(enumerate([*names, *more]), lambda entry: entry[1])
    groups = [(name, [index for index, _ in group]) for name, group in numbered]
    return [{"name": name, "start": at[0], "stop": at[-1] + 1} for name, at in groups]
