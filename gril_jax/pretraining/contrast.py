"""Contrastive loss: frames of demonstrations beside copies with objects displaced.

Cycle-consistency and reconstruction do not constrain states that no demonstration visits. A policy
will find those among them whose latents happen to lie near the goal. This loss gives synthetic
states a distance from the goal, too. They are copies of frames with some objects displaced. Their
distance is `gril_jax.pretraining.final_places.misplacement`, which takes final places from the last
frames of the demonstrations. Videos suffice, without actions or labels.

With `adversarial_steps` each copy first moves to where the present encoder overestimates it most,
as a policy would (adversarial training, Madry et al., ICLR 2018). Scenes that a policy has visited
with an earlier reward can serve in the same way, beside copies or without any. Each batch samples
some from a pool of them (`gril_jax.pretraining.hard_negatives`).

Shapes use V for videos, T for frames, N for objects and D for the latent. A is for the frames of a
video that are copied, J for the copies of each and P for the scenes of a pool.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.audit.scene_reward import Scene
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import Params
from gril_jax.graphs.scene import safe_norm, scene_graph
from gril_jax.types import DemoBatch

from . import batch
from .arrangement import Arrangement, disarray
from .batch import Ends, displaced, other_things
from .final_places import misplacement
from .options import Hyper, Static

_ASCENT, _LAST = 0.1, 0.025  # length units: the first and the last adversarial step
_FINAL = 0.3  # where ends are arrangements: how likely a copied frame is the last one


def contrast(
    params: Params,
    key: PRNGKeyArray,
    demos: DemoBatch,
    active: Bool[Array, "V T N"],
    places: Ends,
    hyper: Hyper,
    config: Static,
    pool: Scene | None = None,
) -> Float[Array, ""]:
    """Mean squared reward errors of synthetic scenes, of frames, and of last frames (0).

    The synthetic scenes are copies of these frames, or come from a pool, or both; each kind has a
    mean of its own. The goal of the reward (Eq. 7) is the mean of the batch's last latents, or with
    several `config.goals` the nearest of the other videos' last latents. A reward of -1 has the
    latent distance `hyper.latent_scale`. Were that measured in the batch, a smaller latent space
    would have a lower loss.

    From a pool of scenes, leaves (P, N, ...), V `perturbed_frames` are sampled, and turned as
    videos are. The key is consumed.
    """
    extent = jnp.max(jnp.abs(demos.center))

    def final(demo, bits):
        scene = _frame(demo, bits, demo.length - 1)
        return _latent(params, scene, demo.present, hyper, config)

    last = jax.vmap(final)(demos, active)
    if config.goals == 1:
        goal = jnp.mean(last, axis=0)
        judge = _Judge(params, goal, places, extent, hyper, config)
        of_video = jax.vmap(functools.partial(_of_video, judge))
        plain, copies = of_video(jax.random.split(key, len(last)), demos, active)
        ends = safe_norm(last - judge.goal) / hyper.latent_scale
    else:
        # Each video is judged by the ends of the others, as a new one will be.
        rest = jnp.array([[i for i in range(len(last)) if i != k] for k in range(len(last))])
        keys = jax.random.split(key, len(last))

        def of_one(key, demo, bits, goals):
            judge = _Judge(params, goals, places, extent, hyper, config)
            return _of_video(judge, key, demo, bits)

        plain, copies = jax.vmap(of_one)(keys, demos, active, last[rest])
        judge = _Judge(params, last, places, extent, hyper, config)
        ends = jax.vmap(lambda one, goals: _away(one, goals))(last, last[rest]) / hyper.latent_scale
    errors = [copies, plain, ends] if config.num_perturbations else [plain, ends]
    if pool is not None:
        key_drawn = jax.random.fold_in(key, len(last))  # the videos have 0 to V - 1
        drawn = _drawn(key_drawn, pool, plain.size, turned=config.turn_scenes)
        everything = jnp.ones(pool.label.shape[1:], bool)
        errors.append(jax.vmap(lambda scene: _excess(judge, scene, everything))(drawn))
    return sum(jnp.mean(_penalty(x, hyper.quartic_weight)) for x in errors)


class _Judge(NamedTuple):
    """Everything needed to judge scenes: the current encoder, and the targets of its output."""

    params: Params
    goal: Float[Array, "D"] | Float[Array, "G D"]
    places: Ends
    extent: Float[Array, ""]  # places lie within |x|, |y| <= this
    hyper: Hyper
    config: Static


def _of_video(
    judge: _Judge, key: PRNGKeyArray, demo: DemoBatch, active: Bool[Array, "T N"]
) -> tuple[Float[Array, "A"], Float[Array, "A J"]]:
    """`_excess` of randomly chosen frames of one video, and of their copies."""

    unit = judge.config.encoder.length_unit

    def anchor(key):
        key_frame, key_copies = jax.random.split(key)
        at = jax.random.randint(key_frame, (), 0, demo.length)
        if judge.config.goal_model == "arrangement":
            final = jax.random.bernoulli(jax.random.fold_in(key_frame, 0), _FINAL)
            at = jnp.where(final, demo.length - 1, at)
        frame = _frame(demo, active, at)
        boxes = frame.center, frame.size, frame.active

        def copy(key):
            made = displaced(key, *boxes, demo, judge.places, judge.extent, unit)
            label, present = other_things(jax.random.fold_in(key, 10), demo, judge.places)
            scene = Scene(made.center, made.size, label, demo.is_robot, made.active)
            return _excess(judge, _ascended(judge, scene, made.moved, present), present)

        copies = jax.vmap(copy)(jax.random.split(key_copies, judge.config.num_perturbations))
        return _excess(judge, frame, demo.present), copies

    return jax.vmap(anchor)(jax.random.split(key, judge.config.perturbed_frames))


def _excess(judge: _Judge, scene: Scene, present: Bool[Array, "N"]) -> Float[Array, ""]:
    """Latent distance from the goal less the scene's cost, in units of the reward."""
    hyper, counted = judge.hyper, present & ~scene.is_robot
    due = cost(judge.places, scene, counted, **cost_options(hyper, judge.config))
    latent = _latent(judge.params, scene, present, hyper, judge.config)
    return _away(latent, judge.goal) / hyper.latent_scale - due


def cost_options(hyper: Hyper, config: Static) -> dict[str, Any]:
    """The options of `cost` that a configuration has."""
    return dict(
        near_cost_fraction=hyper.near_cost_fraction, intrusion_weight=hyper.intrusion_weight,
        touch=hyper.touch, clearance_radius=config.clearance_radius,
    )  # fmt: skip


def cost(
    ends: Ends,
    scene: Scene,
    counted: Bool[Array, "N"],
    *,
    clearance_radius: float = 0.0,
    **costs: Any,
) -> Float[Array, ""]:
    """Cost of what a scene lacks: `misplacement` or `disarray`, to which the options go."""
    objects = scene.center, scene.size, scene.label, counted, scene.active
    if isinstance(ends, Arrangement):
        return disarray(ends, *objects, **costs)
    return misplacement(ends, *objects, **costs, clearance_radius=clearance_radius)


def _away(latent: Float[Array, "D"], goal) -> Float[Array, ""]:
    """The distance of a latent from the goal, or from the nearest of a set."""
    return jnp.min(safe_norm(latent - goal))


def _ascended(
    judge: _Judge, scene: Scene, moved: Bool[Array, "N"], present: Bool[Array, "N"]
) -> Scene:
    """The scene after `adversarial_steps` of its moved objects towards overestimation."""
    params, goal = jax.lax.stop_gradient((judge.params, judge.goal))
    now = judge._replace(params=params, goal=goal)
    slope = jax.grad(lambda center: _excess(now, scene._replace(center=center), present))
    center, steps = scene.center, judge.config.adversarial_steps
    unit = judge.config.encoder.length_unit
    for length in jnp.geomspace(_ASCENT, _LAST, steps) if steps else ():
        down = slope(center)
        step = length * unit * down / jnp.maximum(safe_norm(down)[:, None], 1e-6)
        there = jnp.clip(center - step, -judge.extent, judge.extent)
        center = jnp.where(moved[:, None], there, center)
    return scene._replace(center=center)


def _latent(
    params: Params, scene: Scene, present: Bool[Array, "N"], hyper: Hyper, config: Static
) -> Float[Array, "D"]:
    graph = scene_graph(*scene, present)
    return encoder.apply(params, graph, config.encoder, alpha=hyper.alpha, form="square")


def _frame(demo: DemoBatch, bits: Bool[Array, "T N"], at: Int[Array, ""]) -> Scene:
    """A frame of one video as a scene."""
    return Scene(demo.center[at], demo.size[at], demo.label, demo.is_robot, bits[at])


def _drawn(key: PRNGKeyArray, pool: Scene, num: int, *, turned: bool) -> Scene:
    """Samples scenes of a pool, with replacement; with `turned`, under random symmetries."""
    key_draw, key_turn = jax.random.split(key)
    at = jax.random.randint(key_draw, (num,), 0, pool.label.shape[0])
    scenes = jax.tree.map(lambda x: x[at], pool)
    if not turned:
        return scenes
    still = DemoBatch(  # videos of one frame
        scenes.center[:, None], scenes.size[:, None], scenes.label, scenes.is_robot,
        present=jnp.ones(scenes.label.shape, bool), length=jnp.ones(num, jnp.int32),
    )  # fmt: skip
    still = batch.turn(key_turn, still)
    return scenes._replace(center=still.center[:, 0], size=still.size[:, 0])


def _penalty(error, quartic_weight):
    """Squared error plus a fourth power beyond a tenth, because policies find the worst errors."""
    return error**2 * (1.0 + quartic_weight * (error / 0.1) ** 2)
