"""Plays the policy of a MatchRegions run in our engines and in the original's own, as JSON.

    python -m gril_jax.experiments.fidelity.original_engine RUN      # with pymunk 5.6 installed

The same starts, with the policy's mean actions: shares of episodes that end with success, and of
those that end alike in Chipmunk and in each of ours.
"""

import copy
import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs.magical import simulator
from gril_jax.envs.planar.shapes import SHAPES
from gril_jax.experiments.pipeline import policy_setup, setup
from gril_jax.experiments.pipeline.starts import draw, evaluated_from

from gril_jax.rl.evaluate import evaluate
from gril_jax.runs import run_dir

from .chipmunk import Chipmunk
from .physics_parity import printed

_FIXED = ("demo", "jitter", "layout", "color", "dynamics")  # variants with the task's own shapes


@dataclass(frozen=True)
class _Options:
    run: Annotated[Path, tyro.conf.Positional]
    """A run of MatchRegions."""
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
    """Success of a run's policy by engine."""
    config = run_dir.read_config(folder)
    if config.env.name != "match_regions":
        raise ValueError(f"{folder} is a run of {config.env.name}, but must be of match_regions")
    variant = evaluated_from(config.env).many
    if (variant or config.env.variant) not in _FIXED:
        raise ValueError(f"{folder} is evaluated from {variant}, whose shapes vary")
    key, key_act = jax.random.split(jax.random.key(seed))
    ended = {}
    for engine in ("kernel", "impulse", "chipmunk"):
        ours = dataclasses.replace(config.env, engine="kernel" if engine == "chipmunk" else engine)
        env = setup.make_env(ours, training=False)
        env = _in_chipmunk(env) if engine == "chipmunk" else env
        algorithm = policy_setup.make_algorithm(config, env)
        begun = draw(ours, variant, algorithm.episodes, key, count=episodes).begun
        data = begun.state.data
        memory = jnp.broadcast_to(jnp.asarray(env._rest), (episodes, env._rest.size))
        begun = begun._replace(state=begun.state._replace(data=data._replace(memory=memory)))
        policy = policy_setup.restore_policy(folder, config, algorithm)
        reward = policy_setup.policy_reward(folder, config, env)
        found = evaluate(algorithm, policy, reward, begun, key_act, tau=config.pool.tau)
        ended[engine] = np.asarray(found.success) > 0.5
    alike = {e: round(float((ended[e] == ended["chipmunk"]).mean()), 4) for e in ended}
    shares = {engine: round(float(won.mean()), 4) for engine, won in ended.items()}
    return {"episodes": episodes, "variant": variant, "success": shares, "as_in_chipmunk": alike}


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of a run."""
    options = tyro.cli(_Options, args=argv)
    work = lambda: measure(options.run, episodes=options.episodes, seed=options.seed)  # noqa: E731
    return printed("original_engine", work)


if __name__ == "__main__":
    sys.exit(main())
