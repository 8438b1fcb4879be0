"""A run's learned reward for other JAX code: `gril export RUN --out FILE`."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.demos import schema
from gril_jax.export import reward_format
from gril_jax.graphs import activity_rule
from gril_jax.report.data import read_finished
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs import run_dir
from gril_jax.runs.reading import require_same_demos
from gril_jax.workflows.build import policy_setup, setup, vocabulary
from gril_jax.workflows.build.vocabulary import Vocabulary


def main(folder: Path, out: Path, *, echo: Callable[[str], None] = print) -> None:
    """Writes the reward of a run to a new file."""
    learned = of_run(folder)
    learned.save(out)
    echo(f"wrote {out}")
    if run_dir.read_config(folder).env.name == NO_TASK:
        about = learned.about
        echo(
            f"lengths are in {about['unit']}: a frame shows {about['half_extent']:g} to each side "
            f"of its middle, {about['provenance']['fps']:g} frames a second; objects: "
            f"{', '.join(learned.objects)}"
        )


def of_run(folder: Path) -> LearnedReward:
    """The reward that a run has learned; a RunError if it has none yet."""
    config = run_dir.read_config(folder)
    words = vocabulary.of_run(config, folder)
    params = policy_setup.learned_reward(folder, config, words)
    known: dict[str, Any] = {"run": folder.resolve().name}
    demos = Path(config.demos.path or folder / "demos") / schema.HEADER
    require_same_demos(folder, demos)
    if demos.is_file():  # its entries hold the digests of the demonstrations
        known["demos_sha256"] = schema.digest(demos)
    if "tau" in (found := read_finished(folder) or {}):
        known["kendall_tau"] = found["tau"]
    return described(config, params, words, known)


def described(
    config: RunConfig, params: RewardParams, words: Vocabulary, known: Mapping[str, Any]
) -> LearnedReward:
    """A reward's parameters with all that is needed to use it; `known` is what else is known of
    its training, for `about`."""
    extent = words.half_extent
    if config.encoder.kind == "pixels" and config.env.name != NO_TASK:
        env = setup.make_env(config.env, training=False)
        if hasattr(env, "render"):
            extent = setup.seen_half_extent(env, config.encoder.pixels)
    learned = LearnedReward(
        params, setup.encoder_config(config, len(words.classes)), tuple(words.classes),
        tuple(words.robots), tuple(words.objects), activity_rule.from_json(config.pool.rule()),
    )  # fmt: skip
    provenance = {"seed": config.run.seed, "fps": words.fps, **known}
    text = reward_format.describe(learned, float(extent), words.unit, provenance)
    return dataclasses.replace(learned, description=text)
