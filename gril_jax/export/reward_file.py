"""One file for a learned reward: an .npz of plain arrays and a JSON text, without pickle.

    save_reward("reward.npz", params, config, classes=("goal", "robot", "block"), robots=("robot",))
    learned = load_reward("reward.npz")         # a `gril_jax.reward.learned_reward.LearnedReward`
    r = learned(center, size, active, label=label)

Arrays, named by their path in `RewardParams`, such as `goal`, `scale`, `alpha` and
`encoder.messages.Dense_0.kernel`; and `description`, a JSON text:

    format, version         "gril-jax reward", 3
    encoder                 kind (paper, interaction, mlp, pixel) and the fields of its config
    head                    method that predicts progress (`gril_jax.losses.heads`), if it is one
    activity                the fields of an `ActivityRule` (Eq. 4)
    classes, robots         names that a label is an index into; those that are the robot
    objects                 class of each object of the usual scene, in order; may be empty
    half_extent, unit       half the width of the world that a frame shows, and its unit; or null
    provenance              version of this package, digest and number of the demonstrations, and
                            what else the writer says, such as Kendall's tau

The file ends with a digest of all that is before it (`gril_jax.export.reward_format`). Loading
needs JAX, flax and jraph, and neither MuJoCo nor brax. A file is written whole or not at all; equal
contents give equal bytes.
"""

import dataclasses
import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders.encoder import AnyConfig
from gril_jax.graphs import activity_rule
from gril_jax.graphs.activity_rule import PAPER, ActivityRule
from gril_jax.losses.heads import name_of
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.safe_files import new_file
from gril_jax.types import DemoBatch, checked

from . import reward_format
from .read_policy import unpack
from .reward_format import RewardFileError, packed
from .reward_values import check_values


@checked
def save_reward(
    path: str | os.PathLike,
    params: RewardParams,
    config: AnyConfig,
    *,
    classes: Sequence[str],
    robots: Sequence[str] = (),
    objects: Sequence[str] = (),
    activity: ActivityRule | Mapping[str, Any] = PAPER,
    half_extent: float | None = None,
    unit: str | None = None,
    demos: DemoBatch | None = None,
    provenance: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Writes a reward to a new file.

    Args:
      path: the file, in a folder that exists.
      params: from `gril_jax.reward.from_demos`; of one seed, float32, all finite.
      config: the encoder's, of any kind.
      classes, robots, objects, half_extent, unit: as the description has them; as many classes as
        `config.num_classes`.
      activity: the rule that the reward was made with: {"tau": 0.005, "window": 40}.
      demos: what the reward was learned from; only its digest and number are kept.
      provenance: what else a reader should know, as JSON: {"kendall_tau": 0.95, "source": "..."}.
      overwrite: replace a file of this name.

    Raises:
      RewardFileError: the file exists, its folder is missing, full or not writable, or an array
        is not float32 or not finite.
      ConfigError: choices contradict each other, are out of range, or are no JSON.
      ShapeError: an array has another shape than the encoder's.
    """
    fields = activity._asdict() if isinstance(activity, ActivityRule) else activity
    rule = activity_rule.from_json(fields)
    learned = LearnedReward(params, config, tuple(classes), tuple(robots), tuple(objects), rule)
    made = _digest(demos) if demos is not None else {}
    text = reward_format.describe(learned, half_extent, unit, made | dict(provenance or {}))
    arrays = {name: np.asarray(leaf) for name, leaf in reward_format.named(params)}
    head = None if params.head is None else name_of(params.head)
    wanted = dict(reward_format.named(reward_format.blank(config, head)))
    reward_format.check_arrays(arrays, wanted, "params")
    _write(Path(path), packed(arrays, text), overwrite)


@checked
def save_learned(
    path: str | os.PathLike, learned: LearnedReward, *, overwrite: bool = False
) -> None:
    """Writes a reward with the description that it has; errors are those of `save_reward`."""
    about = learned.about
    save_reward(
        path, learned.params, learned.config, classes=learned.classes, robots=learned.robots,
        objects=learned.objects, activity=learned.activity,
        half_extent=about.get("half_extent"), unit=about.get("unit"),
        provenance=about.get("provenance"), overwrite=overwrite,
    )  # fmt: skip


@checked
def load_reward(path: str | os.PathLike) -> LearnedReward:
    """Reads a reward; its values equal the saved parameters bit for bit.

    Raises:
      RewardFileError: there is no such file, or it is damaged or of another version.
      ConfigError: the file asks for a choice that this version does not have.
      ShapeError: an array has another shape than the encoder's.
    """
    about, arrays = _read(Path(path))
    reward_format.check_version(about, str(path))
    learned = reward_format.understand(about, str(path))
    wanted = dict(reward_format.named(learned.params))
    reward_format.check_arrays(arrays, wanted, str(path))
    leaves = [jnp.asarray(arrays[name]) for name in wanted]
    params = jax.tree.unflatten(jax.tree.structure(learned.params), leaves)
    learned = dataclasses.replace(learned, params=params)
    check_values(learned, about["half_extent"], str(path))
    return learned


def _digest(demos):
    """SHA-256 over the demonstrations' arrays, in the order of `DemoBatch`."""
    total = hashlib.sha256()
    for field, leaf in demos._asdict().items():
        array = np.ascontiguousarray(leaf)
        total.update(f"{field} {array.dtype} {array.shape}".encode() + array.tobytes())
    return {"demos_sha256": total.hexdigest(), "num_demos": int(demos.length.shape[0])}


def _write(path, contents, overwrite):
    try:
        with new_file(path, overwrite=overwrite) as file:
            file.write(contents)
    except FileExistsError:
        raise RewardFileError(
            f"{path} exists already; give another name, or overwrite=True to replace it."
        ) from None
    except (OSError, ValueError) as error:  # of a name with NUL
        raise RewardFileError(
            f"{path} cannot be written ({getattr(error, 'strerror', None) or error}); its folder "
            "must exist and have room."
        ) from None


def _read(path):
    """The description and the arrays of a file that has passed its own digest."""
    try:
        return unpack(path)
    except FileNotFoundError:
        raise RewardFileError(f"{path} does not exist; it must be a file of save_reward.") from None
    except IsADirectoryError:
        raise RewardFileError(f"{path} is a folder; it must be a file of save_reward.") from None
    except (OSError, ValueError) as error:
        named = "" if str(path) in str(error) else f"{path}: "
        raise RewardFileError(f"{named}{error}.") from None
