"""Exports a run's learned reward for other JAX code: `gril export-reward RUN --out FILE`."""

from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from gril_jax.experiments.pipeline import policy_setup, setup

from gril_jax.demos import schema
from gril_jax.interop.reward_file import save_reward
from gril_jax.report.data import read_finished
from gril_jax.runs import run_dir
from gril_jax.runs.covered import require_same_demos

_ACTIVITY = ("tau", "window", "smoothing", "noise")


def main(folder: Path, out: Path, *, echo: Callable[[str], None] = print) -> None:
    """Writes the reward of a run to a new file."""
    config = run_dir.read_config(folder)
    env = setup.make_env(config.env, training=False)
    params = policy_setup.learned_reward(folder, config, env)
    objects = jax.jit(lambda key: env.reset(key).objects)(jax.random.key(0))
    names = [env.classes[i] for i in np.asarray(objects.label)]
    pictures = config.encoder.kind == "pixels" and hasattr(env, "render")
    extent = setup.seen_half_extent(env, config.encoder.pixels) if pictures else env.half_extent
    known = {"run": folder.resolve().name, "seed": config.run.seed}
    demos = Path(config.demos.path or folder / "demos") / schema.HEADER
    require_same_demos(folder, demos)
    if demos.is_file():  # its entries hold the digests of the demonstrations
        known["demos_sha256"] = schema.digest(demos)
    if "tau" in (found := read_finished(folder) or {}):
        known["kendall_tau"] = found["tau"]
    robots = {name for name, flag in zip(names, np.asarray(objects.is_robot), strict=True) if flag}
    save_reward(
        out, params, setup.encoder_config(config, len(env.classes)),
        classes=env.classes, robots=sorted(robots), objects=names,
        activity={name: getattr(config.pool, name) for name in _ACTIVITY},
        half_extent=float(extent), unit=f"world units of {config.env.name}", provenance=known,
    )  # fmt: skip
    echo(f"wrote {out}")
