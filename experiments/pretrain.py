"""Learn a reward from demonstration videos.

    gril pretrain quickstart           about a minute on two CPU cores

Writes a run folder with the demonstrations, the reward, and its profile along each of them.
"""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import checkpoint, pretrain, report, reward, run_dir, subtasks
from gril_jax.config import RunConfig
from gril_jax.demos import demo_batch
from gril_jax.progress import Progress
from gril_jax.reward import RewardParams

from . import demonstrations, setup

__all__ = ["learn", "main"]


def main(config: RunConfig, echo: Callable[[str], None] = print) -> Path:
    """Run it; returns the run's folder."""
    out = Path(config.run.out) if config.run.out else run_dir.default_path(config.run.seed)
    with (
        run_dir.create(out, config, device=setup.device_in_words()) as run,
        Progress() as progress,
    ):
        env = setup.make_env(config.env, training=False)
        demos = demonstrations.gather(config, env, run.path / "demos", progress)
        _, results = learn(config, env, demos, run, progress)
        run.finish(results)
    page = report.write_report(out)
    echo(f"Kendall's tau on held-out demonstrations: {results['tau']:.3f}; report: {page}")
    return out


def learn(
    config: RunConfig,
    env,
    demos: demonstrations.Demonstrations,
    run: run_dir.RunDir,
    progress: Progress,
) -> tuple[RewardParams, dict]:
    """Train the encoder, save the reward and its profiles; returns both."""
    static = setup.pretrain_config(config, len(env.classes))
    hyper = setup.pretrain_hyper(config)
    train, validation = demos.batch("train"), demos.batch("validation")
    key = jax.random.fold_in(jax.random.key(config.run.seed), 0)
    phase = progress.phase("learning the reward", total=config.pretrain.steps)
    state = pretrain.init(key, train, static)
    for done in range(static.updates, config.pretrain.steps + 1, static.updates):
        state, metrics = pretrain.step(state, train, hyper, static)
        row = {name: float(value.mean()) for name, value in metrics._asdict().items()}
        run.log(phase="pretrain", step=done, **row)
        phase.update(done, loss=row["loss"])
    params = reward.from_demos(
        state.params.encoder,
        train,
        static.encoder,
        alpha=hyper.alpha,
        active=pretrain.activity_bits(train, hyper, static),
    )
    checkpoint.save(run.path / "reward", config.pretrain.steps, params)
    measured = pretrain.evaluate(state.params.encoder, validation, train, hyper, static)
    _save_profiles(run.path, params, demos, hyper, static)
    return params, {name: float(value) for name, value in measured.items()} | {
        "demonstrations": {split: len(names) for split, names in demos.names.items()},
        "trimmed_frames": demos.trimmed,
    }


def _save_profiles(folder: Path, params: RewardParams, demos, hyper, static) -> None:
    """The reward along every demonstration, with the ends of its stages marked."""
    owners = [(name, split) for split, names in demos.names.items() for name in names]
    # All in one batch: each length by itself would compile programs of its own.
    batch = demo_batch(demos.demo_set, [name for name, _ in owners])
    profiles = reward.latent_reward(params, pretrain.embed(params.encoder, batch, hyper, static))
    last = jnp.asarray(batch.length)[:, None] - 1
    frames = jnp.arange(profiles.shape[1])
    # A trace that goes on standing where it ends has the same boundaries, and none after its end.
    profiles = jnp.take_along_axis(profiles, jnp.minimum(frames, last), axis=1)
    boundaries = jax.jit(jax.vmap(subtasks.transitions))(profiles)
    np.savez(
        folder / "profiles.npz",
        names=np.array([name for name, _ in owners]),
        split=np.array([split for _, split in owners]),
        length=np.asarray(batch.length, np.int32),
        reward=np.asarray(profiles, np.float32),
        transitions=np.asarray(boundaries & (frames <= last)),
    )
