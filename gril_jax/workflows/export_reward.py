"""Exports a run's learned reward for other JAX code: `gril export RUN --out FILE`."""

from collections.abc import Callable
from pathlib import Path

from gril_jax.config.task import NO_TASK
from gril_jax.demos import schema
from gril_jax.export.reward_file import save_reward
from gril_jax.report.data import read_finished
from gril_jax.runs import run_dir
from gril_jax.runs.covered import require_same_demos
from gril_jax.workflows.build import policy_setup, setup, vocabulary

_ACTIVITY = ("tau", "window", "smoothing", "noise")


def main(folder: Path, out: Path, *, echo: Callable[[str], None] = print) -> None:
    """Writes the reward of a run to a new file."""
    config = run_dir.read_config(folder)
    words = vocabulary.of_run(config, folder)
    params = policy_setup.learned_reward(folder, config, words)
    extent = words.half_extent
    if config.encoder.kind == "pixels" and config.env.name != NO_TASK:
        env = setup.make_env(config.env, training=False)
        if hasattr(env, "render"):
            extent = setup.seen_half_extent(env, config.encoder.pixels)
    known = {"run": folder.resolve().name, "seed": config.run.seed, "fps": words.fps}
    demos = Path(config.demos.path or folder / "demos") / schema.HEADER
    require_same_demos(folder, demos)
    if demos.is_file():  # its entries hold the digests of the demonstrations
        known["demos_sha256"] = schema.digest(demos)
    if "tau" in (found := read_finished(folder) or {}):
        known["kendall_tau"] = found["tau"]
    save_reward(
        out, params, setup.encoder_config(config, len(words.classes)),
        classes=words.classes, robots=words.robots, objects=words.objects,
        activity={name: getattr(config.pool, name) for name in _ACTIVITY},
        half_extent=float(extent), unit=words.unit, provenance=known,
    )  # fmt: skip
    echo(f"wrote {out}")
    if config.env.name == NO_TASK:
        echo(
            f"lengths are in {words.unit}: a frame shows {extent:g} to each side of its middle, "
            f"{words.fps:g} frames a second; objects: {', '.join(words.objects)}"
        )
