"""Which choices of encoder training matter: each changed alone, over several seeds, as a table.

    gril ablate match_regions_fast --demos DEMOS --seeds 5

Seeds and traced values are vmapped in one program; each static choice compiles one. Writes
`ablation.json`, `ablation.md` and `ablation.png`. On a GPU it takes minutes, on two CPU cores
hours: there `--pretrain.steps 500` is enough to see what matters.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import demonstrations, setup

from gril_jax.config import RunConfig
from gril_jax.pretraining import pretrain
from gril_jax.report.figures.spread import spread
from gril_jax.report.figures.style import png
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch

from .named_rows import changed

__all__ = ["CASES", "main", "measure"]

# The untrimmed videos are made here; no field of the configuration asks for them.
_UNTRIMMED = "static tails not trimmed"
_GRAPH = {"loss.decoder": "graph"}

CASES: dict[str, dict[str, Any]] = {
    "as configured": {},
    "no reconstruction": {"loss.lambda_": 0.0},
    "lambda 0.1": {"loss.lambda_": 0.1},
    "lambda 10": {"loss.lambda_": 10.0},
    "temperature 0.1": {"loss.temperature": 0.1},
    "temperature 10": {"loss.temperature": 10.0},
    "alpha 1 (activity bits off)": {"pool.alpha": 1.0},
    "alpha 20": {"pool.alpha": 20.0},
    "no time agreement at first": {"loss.warmup": 0},
    "reconstruction from the latent": _GRAPH,
    "soft-DTW in place of TCC": {"loss.consistency": "soft_dtw"},
    "soft-DTW in place of TCC, from the latent": {"loss.consistency": "soft_dtw"} | _GRAPH,
    "soft-DTW beside TCC": {"loss.consistency": "both"},
    "TCC with variance": {"loss.form": "regression_mse_var"},
    "TCC with Huber's error": {"loss.form": "regression_huber"},
    "TCC as classification": {"loss.form": "classification"},
    "TCC with stochastic matching": {"loss.matching": "stochastic"},
    "TCC with cosine similarity": {"loss.similarity": "cosine", "loss.temperature": 0.1},
    "no message passing": {"encoder.rounds": 0},
    "1 round of messages": {"encoder.rounds": 1},
    "4 rounds of messages": {"encoder.rounds": 4},
    "robot pooled": {"encoder.pool_robot": True, "encoder.robot_messages": True},
    "GraphIRL's interaction network": {"encoder.kind": "interaction"},
    "GraphIRL's MLP": {"encoder.kind": "mlp"} | _GRAPH,
    "scenes not turned": {"pretrain.turn_scenes": False},
    "no untouched object counts as moved": {"pretrain.touched": 0.0},
    _UNTRIMMED: {},
}


def main(config: RunConfig, seeds: int, echo: Callable[[str], None] = print) -> Path:
    """Run every case; returns the folder."""
    out = Path(config.run.out) if config.run.out else run_dir.default_path(config.run.seed)
    with (
        run_dir.create(out, config, device=setup.device_in_words()) as run,
        Progress() as progress,
    ):
        env = setup.make_env(config.env, training=False)
        demos = demonstrations.gather(config, env, run.path / "demos", progress)
        phase = progress.phase("ablating", total=len(CASES), unit="cases")
        found: dict[str, dict[str, np.ndarray]] = {}
        for names in groups(config).values():
            train, validation = demos.batch("train"), demos.batch("validation")
            if names == [_UNTRIMMED]:
                train = untrimmed(train, demos.trimmed_of("train"))
            found |= measure(config, names, train, validation, len(env.classes), seeds)
            _write(out, {name: found[name] for name in CASES if name in found}, seeds)
            phase.update(len(found))
        run.finish({"cases": len(found), "seeds": seeds})
    echo((out / "ablation.md").read_text())
    echo(f"written to {out}")
    return out


def _write(out: Path, found: Mapping[str, Mapping[str, np.ndarray]], seeds: int) -> None:
    """After every program, so that a run that is cut short leaves what it has."""
    with run_dir.writing(out):
        numbers = {k: {m: v.tolist() for m, v in row.items()} for k, row in found.items()}
        (out / "ablation.json").write_text(json.dumps(numbers, indent=1) + "\n")
        (out / "ablation.md").write_text(markdown(found, seeds) + "\n")
        figure = spread({k: row["tau"] for k, row in found.items()}, "tau on held-out videos")
        (out / "ablation.png").write_bytes(png(figure))


def groups(config: RunConfig) -> dict[Any, list[str]]:
    """The cases, by what they compile."""
    same = defaultdict(list)
    for name, change in CASES.items():
        static = setup.pretrain_config(changed(config, change), 1)
        same[static, name == _UNTRIMMED].append(name)
    return dict(same)


def measure(
    config: RunConfig,
    names: list[str],
    train: DemoBatch,
    validation: DemoBatch,
    num_classes: int,
    seeds: int,
) -> dict[str, dict[str, np.ndarray]]:
    """What `pretrain.evaluate` finds for some cases of one program: case to metric to (seeds,)."""
    cases = [changed(config, CASES[name]) for name in names]
    static = setup.pretrain_config(cases[0], num_classes)
    hyper = [jax.tree.map(jnp.float32, setup.pretrain_hyper(case)) for case in cases]
    hyper = jax.tree.map(lambda *x: jnp.stack(x), *hyper)
    keys = jax.random.split(jax.random.key(config.run.seed), seeds)

    def over(function, *axes):
        """One axis of cases, then one of seeds."""
        return jax.vmap(jax.vmap(function, axes[0]), axes[1])

    states = jax.vmap(pretrain.init, (0, None, None))(keys, train, static)
    states = jax.tree.map(lambda x: jnp.stack([x] * len(cases)), states)
    step = over(pretrain.step, (0, None, None, None), (0, None, 0, None))
    for _ in range(config.pretrain.steps // static.updates):
        states, _ = step(states, train, hyper, static)
    evaluate = over(pretrain.evaluate, (0, None, None, None, None), (0, None, None, 0, None))
    values = evaluate(states.params.encoder, validation, train, hyper, static)
    return {
        name: {metric: np.asarray(value[i]) for metric, value in values.items()}
        for i, name in enumerate(names)
    }


def untrimmed(batch: DemoBatch, trimmed: list[int]) -> DemoBatch:
    """Demonstrations that stand still at their end for as many frames as had been cut off."""
    longest = max(int(n) + t for n, t in zip(batch.length, trimmed, strict=True))
    frames = jnp.minimum(jnp.arange(longest), batch.length[:, None] - 1)

    def held(x):
        return jnp.take_along_axis(x, frames[:, :, None, None], axis=1)

    return batch._replace(
        center=held(batch.center),
        size=held(batch.size),
        length=batch.length + jnp.asarray(trimmed, batch.length.dtype),
    )


def markdown(found: Mapping[str, Mapping[str, np.ndarray]], seeds: int) -> str:
    """One row a case: mean over the seeds, and from the lowest to the highest."""
    heads = {"tau": "tau", "reward_time_tau": "reward against time", "reward_last": "last reward"}
    lines = [f"| {seeds} seeds | " + " | ".join(heads.values()) + " |", "|---|---|---|---|"]
    for name, row in found.items():
        cells = (f"{row[m].mean():.3f} ({row[m].min():.3f} to {row[m].max():.3f})" for m in heads)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
