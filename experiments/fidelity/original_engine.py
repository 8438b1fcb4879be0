"""Plays the policies of a MatchRegions run in our engines and in the original's own, as JSON.

    python -m gril_jax.experiments.fidelity.original_engine RUN      # with pymunk 5.6 installed

RUN may be a sweep, with each of its policies. The same starts, with mean actions: shares of
episodes that end with success, and of those that end alike in Chipmunk and in each of ours.
"""

import copy
import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs.magical import simulator
from gril_jax.envs.planar.shapes import SHAPES
from jaxtyping import Bool

from gril_jax.config import RunConfig
from gril_jax.rl import training
from gril_jax.rl.evaluate import evaluate
from gril_jax.rl.policy import Policy
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import checkpoint, manifest
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.build.starts import draw, evaluated_from

from .chipmunk import Chipmunk
from .physics_parity import printed

_FIXED = ("demo", "jitter", "layout", "color", "dynamics")  # variants with the task's own shapes


@dataclass(frozen=True)
class _Options:
    run: Annotated[Path, tyro.conf.Positional]
    """A run or a sweep of MatchRegions."""
    episodes: int = 256
    """Starts to draw."""
    seed: int = 0
    """Seed of the starts."""


def _in_chipmunk(env):
    """The task with the original's engine."""
    preset = simulator.PRESETS[env.physics]
    kinds = tuple(SHAPES[k] for k in env._shape)
    own = copy.copy(env)
    own._engine = Chipmunk(
        env.robot, kinds, arena=preset.arena, block_mass=preset.block_mass,
        pins=env.physics == "magical",
    )  # fmt: skip
    own._rest = np.asarray(own._engine.rest())
    return own


def measure(folder: Path, *, episodes: int = 256, seed: int = 0) -> dict:
    """Success of each policy of a run by engine; where policies end alike, of all episodes."""
    config = run_dir.read_config(folder)
    if config.env.name != "match_regions":
        raise ValueError(f"{folder} is a run of {config.env.name}, but must be of match_regions")
    variant = evaluated_from(config.env).many
    if (variant or config.env.variant) not in _FIXED:
        raise ValueError(f"{folder} is evaluated from {variant}, whose shapes vary")
    ended = {}
    for engine in ("kernel", "impulse", "chipmunk"):
        there = engine == "chipmunk"
        env = dataclasses.replace(config.env, engine="kernel" if there else engine)
        ours, key = dataclasses.replace(config, env=env), jax.random.key(seed)
        ended[engine] = _ended(folder, ours, variant, key, episodes, there=there)
    alike = {e: round(float((ended[e] == ended["chipmunk"]).mean()), 4) for e in ended}
    shares = {engine: won.mean(axis=1).round(4).tolist() for engine, won in ended.items()}
    return {"episodes": episodes, "variant": variant, "success": shares, "as_in_chipmunk": alike}


def _ended(folder, config, variant, key, episodes, *, there) -> Bool[np.ndarray, "P E"]:
    """True for each episode of each policy that ends well, `there` in the original engine."""
    env = setup.make_env(config.env, training=False)
    env = _in_chipmunk(env) if there else env
    algorithm = policy_setup.make_algorithm(config, env)
    key, key_act = jax.random.split(key)
    begun = draw(config.env, variant, algorithm.episodes, key, count=episodes).begun
    data = begun.state.data
    memory = jnp.broadcast_to(jnp.asarray(env._rest), (episodes, env._rest.size))
    begun = begun._replace(state=begun.state._replace(data=data._replace(memory=memory)))
    reward = policy_rewards.blank(config, env)  # what it pays changes no action

    @jax.jit
    def play(policy):
        return evaluate(algorithm, policy, reward, begun, key_act, tau=config.pool.tau).success

    return np.stack([play(policy) > 0.5 for policy in _policies(folder, config, algorithm)])


def _policies(folder: Path, config: RunConfig, algorithm: training.Algorithm) -> Iterator[Policy]:
    """The policy of a run, or all those of a sweep."""
    programs = sorted((folder / "policies").glob("*"))
    if not programs:
        yield policy_setup.restore_policy(folder, config, algorithm)
    like = policy_setup.fresh_policy(config, algorithm, jax.random.key(0))
    for program in programs:
        (saved,) = program.iterdir()
        count = manifest(saved)["leaves"][0]["shape"][0]
        many = jax.tree.map(lambda leaf: np.zeros((count, *leaf.shape), leaf.dtype), like)  # noqa: B023
        found = checkpoint.restore(saved, many)
        yield from (jax.tree.map(lambda leaf: leaf[k], found) for k in range(count))  # noqa: B023


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of a run."""
    options = tyro.cli(_Options, args=argv)
    work = lambda: measure(options.run, episodes=options.episodes, seed=options.seed)  # noqa: E731
    return printed("original_engine", work)


if __name__ == "__main__":
    sys.exit(main())
