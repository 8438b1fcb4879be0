"""Each reward as a file with its goals, `rewards/ROW-SEED.npz` in the study's folder."""

from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.export.reward_file import save_reward
from gril_jax.workflows.build import setup, vocabulary

from ..rewards import reward_key
from ..saved import Plan, root, row_files
from .measure import Measure


def measure(plan: Plan, run: Path) -> Measure:
    """Writes the rewards of a row, named after the first row that has them."""
    files = row_files(run, [*plan.rows])

    def stem(config: RunConfig) -> str:
        apart = config.run.seed - plan.config.run.seed
        key = reward_key(with_seed(config, -apart))
        return next(files[name].stem for name, row in plan.rows.items() if reward_key(row) == key)

    def write(programs, config, found) -> dict[str, Any]:
        env = setup.make_env(config.env, training=False)
        words = vocabulary.of_task(env, config.env.name)
        out = root(run) / "rewards"
        out.mkdir(parents=True, exist_ok=True)
        pool = config.pool
        rule = {name: getattr(pool, name) for name in ("tau", "window", "smoothing", "noise")}
        names = [f"{stem(config)}-{config.run.seed + i}" for i in range(len(found))]
        for name, one in zip(names, found, strict=True):
            save_reward(
                out / f"{name}.npz", one.params, setup.encoder_config(config, len(words.classes)),
                classes=words.classes, robots=words.robots, objects=words.objects, activity=rule,
                half_extent=words.half_extent, unit=words.unit,
                provenance={"kendall_tau": one.tau, "seed": config.run.seed}, overwrite=True,
            )  # fmt: skip
        return {"files": names}

    return Measure("files", write)
