"""Learns a reward from demonstration videos; saves it, its demonstrations and its profiles.

gril pretrain quickstart           about a minute on two CPU cores
gril pretrain --resume RUN         go on with a run that was cut off
gril pretrain quickstart --hard-negatives RUN    learn from states that RUN's reward overestimates
"""

import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.report import run_report
from gril_jax.report.data import SPLITS
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import state_leaves
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.subtasks import agreement
from gril_jax.workflows.build import demonstrations, hard_negatives, learners, setup, vocabulary
from gril_jax.workflows.build.hard_negatives import EarlierPolicy, Echo
from gril_jax.workflows.learning import encoders

_STAGES = {"prominence": 0.125, "smoothing": 15}  # how ends of stages are found in each trace


class OpenRun(NamedTuple):
    """A run, with what every part of it needs."""

    config: RunConfig
    dir: Run
    progress: Progress
    echo: Echo  # says what happens
    policies: Sequence[EarlierPolicy]  # that give hard negatives

    @property
    def path(self) -> Path:
        """The run's folder; a RunError where no folder keeps it."""
        if self.dir.path is None:
            raise RunError("the run has no folder, but must have one for its files")
        return self.dir.path


@contextlib.contextmanager
def opened(
    config: RunConfig, experiment: str, resume: Path | None, policies: Sequence[Path], echo: Echo
) -> Iterator[OpenRun]:
    """A new run of a verb, or the one in the folder `resume`, whose configuration it has, open.

    The policies are of runs that give hard negatives; a resumed run has noted its own. Raises
    ConfigError if one cannot be read, or if a reward of pictures is involved.
    """
    loaded = [hard_negatives.load(folder) for folder in policies]
    hard_negatives.require_boxes(config, loaded)
    known = {"device": setup.device_in_words(), "experiment": experiment}
    known["begun"] = hard_negatives.noted(loaded)
    with run_dir.create_or_resume(config, resume, **known) as run, Progress() as progress:
        for sentence in (f"writing to {run.path}", *run.said):
            echo(sentence)
        yield OpenRun(config, run, progress, echo, loaded)


def main(
    config: RunConfig,
    *,
    resume: Path | None = None,
    hard_negatives: Sequence[Path] = (),
    echo: Echo = print,
) -> Path:
    """Runs it, or goes on with the run in the folder `resume`; see `opened`. Returns its folder."""
    env = setup.task_of(config.env)
    demonstrations.require_usable(config, env, begun=resume is not None)
    with opened(config, "pretrain", resume, hard_negatives, echo) as run:
        if resume is None and (said := demonstrations.announced(config)):
            echo(said)
        demos = demonstrations.gather_once(config, env, run.dir, run.progress)
        if env is None:
            words = vocabulary.of_set(demos.demo_set, config.env.name)
            echo(
                f"classes {', '.join(words.classes)}; lengths in {words.unit}, of which a frame "
                f"shows {words.half_extent:g} to each side; {words.fps:g} frames a second"
            )
        results = learn(run, demos)
        run.dir.finish(results)
    page = run_report.write_report(run.path)
    tau = f"{results['tau']:.3f}" if "tau" in results else "unknown, since only one is held out"
    echo(f"alignment tau on held-out demonstrations: {tau}; report: {page}")
    return run.path


def learn(run: OpenRun, demos: demonstrations.Demonstrations) -> dict[str, Any]:
    """Trains the encoder, saves the reward and its profiles, once in a run; returns the results.

    States that the rewards of earlier policies overestimated are learned from, too.
    """
    results = run.dir.finished_phase("reward")
    if results is not None:
        return results
    config = run.config
    pool = hard_negatives.gather_once(
        run.policies, config, demos.batch("train"), run.dir, run.progress, echo=run.echo
    )
    learner = learners.learner(config, demos, pool)
    owners = [(name, split) for split in SPLITS for name in demos.names[split]]
    # All in one batch: each length by itself would compile programs of its own.
    films = learner.films([name for name, _ in owners])
    with ahead.compiling() as compilers:
        programs = encoders.compiled_for([config], learner, compilers)
        successes = len(owners) - len(demos.names["failure"])
        profiles_of = _profiles_program(config, learner, programs, films, successes, compilers)
        trained = encoders.train(
            programs, [config], name="pretrain", run=run.dir, progress=run.progress, echo=run.echo,
            what="learning the reward", row=_means,
        )  # fmt: skip
        params, found, state = _only((trained.rewards, trained.measures, trained.state))
        rewards, ends = profiles_of.result()(params, films, _only(programs.hyper))
    saved = run.dir.save_part("reward", config.pretrain.steps, params)
    saved += run.dir.save_arrays(
        "profiles.npz",
        names=np.array([name for name, _ in owners]),
        split=np.array([split for _, split in owners]),
        length=np.asarray(films.length, np.int32),
        reward=np.asarray(rewards, np.float32),
        transitions=np.asarray(ends),  # True where stages end
    )
    rows = [row for row in run.dir.metrics() if row["phase"] == "pretrain"]
    results = {name: float(value) for name, value in found.items()} | {
        "consistency": rows[-1]["consistency"],
        "demonstrations": {split: len(names) for split, names in demos.names.items() if names},
        "trimmed_frames": demos.trimmed,
        "hard_negatives": 0 if pool is None else len(pool.label),
        "reward_sha256": state_leaves.digest(params),
        "state_sha256": state_leaves.digest(state),
    }
    run.dir.finish_phase("reward", results, saved)
    return results


def _profiles_program(
    config: RunConfig,
    learner: learners.Learner,
    programs: encoders.Programs,
    films: Any,
    successes: int,
    pool: Executor,
) -> Future[Any]:
    """The program (reward, videos, hyper) -> rewards and stage ends, being compiled."""

    def profiles(params, films, hyper):
        latents = learner.latents(params.encoder, films, hyper)
        return _profiles(params, latents, films.length, successes=successes)

    def ready() -> Any:
        key, hyper = jax.eval_shape(_first, (programs.keys, programs.hyper))
        state = jax.eval_shape(learner.init, key, learner.data)
        params = jax.eval_shape(learner.reward, state, learner.data, hyper)
        with ahead.tracing():
            lowered = jax.jit(profiles).lower(params, films, hyper)
        return compiled(lowered, brief=config.encoder.kind != "pixels")

    return pool.submit(ready)


def _first(tree: Any) -> Any:
    """What a tree has of the first seed."""
    return jax.tree.map(lambda x: x[0], tree)


_only = jax.jit(_first)


def _means(metrics: Any) -> dict[str, float]:
    """The means of a chunk's updates."""
    return {name: float(value[0].mean()) for name, value in metrics._asdict().items()}


def _profiles(
    params: RewardParams, latents: Float[Array, "B T D"], length: Int[Array, "B"], *, successes: int
) -> tuple[Float[Array, "B T"], Bool[Array, "B T"]]:
    """Rewards, padded with the last one of each demonstration, and the frames that end stages."""
    rewards = reward.latent_reward(params, latents)
    frames = jnp.minimum(jnp.arange(rewards.shape[1]), length[:, None] - 1)
    rewards = jnp.take_along_axis(rewards, frames, axis=1)
    return rewards, _stage_ends(rewards, length, successes=successes)


def _stage_ends(
    rewards: Float[Array, "B T"], length: Int[Array, "B"], *, successes: int
) -> Bool[Array, "B T"]:
    """Frames at which stages end: as the first demonstrations, the successes, agree on them.

    Of the others, which failed, it is what each shows by itself.
    """
    patience, agreed = agreement.agreed_stages(rewards[:successes], length[:successes], **_STAGES)
    failed = rewards[successes:], length[successes:]
    alone = agreement.each_alone(*failed, **_STAGES, patience=patience)
    ends = jnp.concatenate([agreed.frames, alone])
    return (ends[:, :, None] == jnp.arange(rewards.shape[1])).any(axis=1)
