"""Collects states that a learned reward overestimates, as hard negatives for the next one.

gril pretrain quickstart --hard-negatives RUN          one round
gril train quickstart --hard-negatives RUN,RUN         the runs of two rounds together

The policies of finished runs play in their own task. States are chosen by the boxes of
these episodes, the policies' learned rewards and the demonstrations' last frames alone, without the
task's reward or success. The scenes enter the loss with the weight `loss.perturbation_weight`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import reward
from gril_jax.audit.scene_reward import Scene
from gril_jax.config import RunConfig
from gril_jax.config.tables import ALIGNMENTS
from gril_jax.demos import schema
from gril_jax.errors import ConfigError, RunError
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.hard_negatives import choose
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl.evaluate import begin, evaluate
from gril_jax.rl.policy import Policy
from gril_jax.rl.training import Algorithm
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import new_file, writing
from gril_jax.types import DemoBatch

from . import policy_setup, setup, video_ends

_FILE = "hard_negatives.npz"
_EACH = 256  # scenes of each run; a batch of eight videos samples 64

Echo = Callable[[str], None]


class EarlierPolicy(NamedTuple):
    """The policy of a run, its task, and the reward that trained it."""

    folder: Path
    config: RunConfig
    algorithm: Algorithm  # of the task's own starts
    policy: Policy
    policy_reward: Any
    learned: RewardParams


def load(folder: Path) -> EarlierPolicy:
    """The policy of a run, whose folder is only read; ConfigError if it has none."""
    try:
        config = run_dir.read_config(folder)
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        policy = policy_setup.restore_policy(folder, config, algorithm)
        policy_reward = policy_setup.policy_reward(folder, config, env)
        learned = policy_setup.learned_reward(folder, config, env)
        return EarlierPolicy(folder, config, algorithm, policy, policy_reward, learned)
    except RunError as error:
        raise ConfigError(f"--hard-negatives: {error}") from None


def require_boxes(config: RunConfig, policies: Sequence[EarlierPolicy]) -> None:
    """Raises ConfigError if a reward of pictures would teach or be taught by earlier policies, or
    if the new one predicts progress."""
    if policies and ALIGNMENTS[config.loss.consistency].head:
        raise ConfigError(
            f"loss.consistency is {config.loss.consistency!r}, whose reward is no distance, but "
            "hard negatives teach distances: choose another one, or leave out --hard-negatives"
        )
    for each in (config, *(earlier.config for earlier in policies)) if policies else ():
        setup.require_boxes(each, "--hard-negatives, in the new run and in those that it names")


def noted(policies: Sequence[EarlierPolicy]) -> dict[str, dict[str, Any]]:
    """The note of a new run: whose scenes it learns from, should it be cut off."""
    runs = [str(earlier.folder.resolve()) for earlier in policies]
    return {"hard_negatives_of": {"runs": runs}} if runs else {}


def gather_once(
    policies: Sequence[EarlierPolicy],
    config: RunConfig,
    demos: DemoBatch,
    run: run_dir.RunDir,
    progress: Progress,
    *,
    echo: Echo = print,
) -> Scene | None:
    """Plays and chooses the scenes once; later calls read them from the run's folder.

    A run that goes on loads the policies that it noted if it has to. The last frames of the
    demonstrations, which the run trains on, say what belongs where.

    Returns leaves (P, N, ...); None where no run was noted, and where nothing is overestimated.
    """
    known = run.finished_phase("hard_negatives_of")
    if known is None:
        return None
    if run.finished_phase("hard_negatives") is None:
        policies = policies or [load(Path(name)) for name in known["runs"]]
        found = [_overestimated(earlier, config, demos, progress) for earlier in policies]
        pool = jax.tree.map(lambda *parts: np.concatenate(parts), *found)
        with writing(run.path), new_file(run.path / _FILE, overwrite=True) as file:
            np.savez(file, **pool._asdict())
        counts = [len(scenes.label) for scenes in found]
        digest = schema.digest(run.path / _FILE)
        run.finish_phase("hard_negatives", {"sha256": digest, "scenes": counts})
        for earlier, count in zip(policies, counts, strict=True):
            echo(f"{count} scenes of {earlier.folder} are overestimated and will be learned from")
    return _read(run.path / _FILE, run.finished_phase("hard_negatives"))


def _overestimated(
    earlier: EarlierPolicy, config: RunConfig, demos: DemoBatch, progress: Progress
) -> Scene:
    """The chosen scenes of one run on the host, leaves (K, N, ...)."""
    classes = earlier.algorithm.episodes.env.classes
    played = _play(earlier, progress)
    own = setup.pretrain_hyper(earlier.config), setup.embedding_config(earlier.config, len(classes))
    latents = pretrain.embed(earlier.learned.encoder, played, *own)
    paid = reward.latent_reward(earlier.learned, latents)
    scenes, due = video_ends.owed(played, config, demos, classes)
    chosen = choose(scenes, paid, due, num=_EACH)
    known = np.asarray(chosen.known)
    return jax.tree.map(lambda x: np.asarray(x)[known], chosen.scenes)


def _play(earlier: EarlierPolicy, progress: Progress) -> DemoBatch:
    """Episodes as if they were videos, with deterministic actions, then with sampled ones."""
    episodes = earlier.config.run.eval_episodes
    phase = progress.phase("playing an earlier policy", total=2 * episodes, unit="episodes")
    key = jax.random.fold_in(jax.random.key(earlier.config.run.seed), 3)
    parts = []
    for drawn in (False, True):
        key_begin, key_act = jax.random.split(jax.random.fold_in(key, drawn))
        found = evaluate(
            earlier.algorithm, earlier.policy, earlier.policy_reward,
            begin(earlier.algorithm.episodes, key_begin, episodes=episodes), key_act,
            tau=earlier.config.pool.tau, deterministic=jnp.asarray(not drawn),
        )  # fmt: skip
        parts.append(jax.block_until_ready(found.states.objects))
        phase.update(episodes * len(parts))
    return video_ends.as_videos(jax.tree.map(lambda *x: jnp.concatenate(x), *parts))


def _read(file: Path, saved: dict[str, Any]) -> Scene | None:
    if not file.is_file() or schema.digest(file) != saved["sha256"]:
        raise RunError(f"{file} has been changed or lost, so the run cannot go on with it")
    with np.load(file) as arrays:
        pool = Scene(*(jnp.asarray(arrays[name]) for name in Scene._fields))
    return pool if len(pool.label) else None
