"""Audits a reward that was learned from videos alone: what can be asked without a task.

gril audit RUN            a run of `gril pretrain --demos SET`, seconds on two CPU cores

Held-out videos say how a demonstration begins and ends. The audit makes up scenes of two kinds from
them. In the first nothing has moved, but everything counts as touched. In the second an object has
been put elsewhere at the end. The reward of both must be low. Only a task defines success, so the
rest of an audit is left out, and a sentence says so.
"""

import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.config import RunConfig
from gril_jax.errors import DemoError
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.batch import Ends, displaced
from gril_jax.pretraining.hard_negatives import due_rewards
from gril_jax.report.data import read_finished
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs.json_lines import plain
from gril_jax.runs.reading import require_same_demos
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import demonstrations, policy_setup, setup, vocabulary

LEFT_OUT = (
    "left out, because videos do not define success: the gradient search, the hack gap, the "
    "ranking of synthetic stages and the maps, which gril audit has for a reward with a task"
)
_TOUCH, _MISRANKED = 0.05, 0.02  # most rise by a touch, and most misranked scenes; shares
_AMISS = 0.25  # cost of a made-up scene that is clearly not done; of a beginning it is about 1


def of_run(folder: Path, config: RunConfig, *, scenes: int, seed: int) -> dict[str, Any]:
    """The audit of a run's reward as JSON has it; `scenes` are made up around held-out videos.

    Raises DemoError if the videos are gone.
    """
    setup.require_boxes(config, "an audit, which moves boxes")
    source = Path(config.demos.path)
    if not source.is_dir():
        raise DemoError(f"{source} is gone, but the audit makes its scenes from these videos")
    require_same_demos(folder, source / "demos.json")
    demos = demonstrations.chosen(config, None, source)
    words = vocabulary.of_run(config, folder)
    params = policy_setup.learned_reward(folder, config, words)
    results = read_finished(folder) or {}
    known = {name: results.get(name) for name in ("tau", "reward_time_tau")}
    return plain(measured(config, params, demos, scenes=scenes, seed=seed) | known)


def in_words(found: dict[str, Any]) -> list[str]:
    """Sentences on what was found."""
    worst = found["misranked_share"]
    return [
        ("passes as far as videos can tell" if found["passes_as_far_as_asked"] else "fails"),
        f"touching all and moving nothing increases the reward by {found['touch_share']:.0%} "
        f"of the range (at most {_TOUCH:.0%})",
        f"{worst:.1%} of {found['scenes']} scenes with something out of place have a higher reward "
        f"than the worst held-out end (at most {_MISRANKED:.0%}); the best of them has "
        f"{found['best_amiss_share']:.0%} of the range",
        LEFT_OUT,
    ]


def measured(
    config: RunConfig,
    params: RewardParams,
    demos: demonstrations.Demonstrations,
    *,
    scenes: int = 1000,
    seed: int = 0,
) -> dict[str, Any]:
    """The audit as plain numbers; shares are of the range from first to last frames."""
    found = _measure(config, params, demos, len(demos.demo_set.classes), scenes, seed)
    sound = found["touch_share"] <= _TOUCH and found["misranked_share"] <= _MISRANKED
    return found | {"passes_as_far_as_asked": sound, "left_out": LEFT_OUT}


def _measure(config, params, demos, num_classes, scenes, seed) -> dict[str, Any]:
    """The measures, as plain numbers."""
    static, hyper = setup.pretrain_config(config, num_classes), setup.pretrain_hyper(config)
    train, held = demos.batch("train"), demos.batch("validation")
    places = pretrain.places(train, num_classes, static)
    bits = pretrain.activity_bits(held, hyper, static)
    pay = jax.jit(jax.vmap(functools.partial(scene_reward(static.encoder), params)))
    movable = held.present & ~held.is_robot
    begin, end = _frames(held, bits, 0 * held.length), _frames(held, bits, held.length - 1)
    first, last = pay(begin), pay(end)
    touched = pay(begin._replace(active=begin.active | movable))
    spread = jnp.maximum(jnp.mean(last - first), 1e-6)
    made = _amiss(jax.random.key(seed), held, end, places, scenes, static.encoder.length_unit)
    paid = dict(
        near_cost_fraction=hyper.near_cost_fraction, intrusion_weight=hyper.intrusion_weight,
        clearance_radius=static.clearance_radius,
    )  # fmt: skip
    due = -due_rewards(places, made, **paid)
    paid, amiss = np.asarray(pay(made)), np.asarray(due) > _AMISS
    if not amiss.any():
        paid, amiss = np.full(1, float(jnp.mean(first))), np.ones(1, bool)
    return {
        "held_out": len(held.length),
        "range": float(spread),
        "touch_share": float(jnp.mean(touched - first) / spread),
        "scenes": int(amiss.sum()),
        "misranked_share": float(np.mean(paid[amiss] > float(last.min()))),
        "best_amiss_share": float((paid[amiss].max() - jnp.mean(first)) / spread),
    }


def _frames(demos: DemoBatch, bits, at) -> Scene:
    """One frame of each video, leaves (B, N, ...)."""
    rows = jnp.arange(len(at))
    still = demos.label, demos.is_robot
    return Scene(demos.center[rows, at], demos.size[rows, at], *still, bits[rows, at])


def _amiss(key, held: DemoBatch, end: Scene, places: Ends, number: int, unit) -> Scene:
    """Ends of videos with some objects displaced, leaves (number, N, ...). The key is consumed."""
    extent = jnp.max(jnp.abs(held.center))
    which = jnp.arange(number) % len(held.length)

    def one(key, film):
        scene, demo = (jax.tree.map(lambda x: x[film], tree) for tree in (end, held))
        boxes = scene.center, scene.size, scene.active
        copy = displaced(key, *boxes, demo, places, extent, unit)
        return scene._replace(center=copy.center, size=copy.size, active=copy.active)

    return jax.jit(jax.vmap(one))(jax.random.split(key, number), which)
