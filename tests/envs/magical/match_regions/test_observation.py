"""Observations, against the reference's vector and number by number."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.match_regions import observation as observations
from gril_jax.envs.magical.match_regions.observation import Observed
from support import planar_scenes, scenes

from gril_jax import envs

BLOCKS = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
GOAL = jnp.array([0.40, 0.35, 0.60, 0.70])
DEMO = [
    -0.5, 0.1, 0.8, -0.7, -0.68, 0.72, -0.05, -0.2, -0.75, -0.55, 0.3, -0.82, -0.8090, 0.5878,
    0.5397, 0.2283, 0.3973, 0.4036, 0.1912, 0.2462, 0.4310, 0.2512, 0.5163, 0.4152, 1.0,
]  # fmt: skip


def _scene(robot, base=(-0.5, 0.1, -1.2 * math.pi), opening=planar_scenes.OPEN, seed=None):
    parts = planar_scenes.parts(robot, base, opening)
    pose = np.concatenate([parts, [scenes.BLOCKS[b] for b in BLOCKS]])
    velocity = np.zeros_like(pose)
    if seed is not None:
        velocity = np.random.default_rng(seed).normal(size=pose.shape)
    inside = np.arange(5) == 3
    floats = (jnp.asarray(f, jnp.float32) for f in (pose, velocity))
    return Observed(*floats, GOAL, jnp.asarray(inside)), len(parts)


@pytest.mark.parametrize(("robot", "size"), [("gripper", 25), ("long", 24)])
def test_xmagicals_vector_at_the_demo_start_is_the_references(robot, size):
    scene, parts = _scene(robot)
    seen = observations.observe("xmagical", scene, parts=parts, targets=2)
    assert seen.shape == (size,)
    np.testing.assert_allclose(seen, DEMO[:size], atol=6e-5)


def test_a_task_sees_the_references_vector_at_its_demo_start():
    env = envs.make("match_regions", observation="xmagical")
    np.testing.assert_allclose(jax.jit(env.reset)(jax.random.key(0)).obs, DEMO, atol=6e-5)


@pytest.mark.parametrize(("opening", "value"), [(0.0, 0.0), (0.1, 0.2546), (0.5, 1.0), (-0.1, 0.0)])
def test_xmagicals_finger_opening_is_a_share_of_45_degrees_within_0_and_1(opening, value):
    scene, parts = _scene("gripper", opening=opening)
    seen = observations.observe("xmagical", scene, parts=parts, targets=2)
    assert float(seen[-1]) == pytest.approx(value, abs=1e-4)


def _named(kind, scene, parts, robot):
    seen = np.asarray(observations.observe(kind, scene, parts=parts, targets=2))
    names = observations.names(kind, BLOCKS, fingers=robot == "gripper", targets=2)
    assert len(names) == len(seen)
    return {name: [x for n, x in zip(names, seen, strict=True) if n == name] for name in set(names)}


@pytest.mark.parametrize("robot", ["gripper", "medium"])
def test_names_of_the_rich_vector_tell_what_its_numbers_are(robot):
    scene, parts = _scene(robot, base=(0.3, -0.2, 0.7), seed=0)
    seen = _named("rich", scene, parts, robot)
    pose, velocity = np.asarray(scene.pose), np.asarray(scene.velocity)
    local = planar_scenes.turned(pose[parts:, :2] - pose[0, :2], -0.7)
    close = lambda name, value: np.testing.assert_allclose(seen[name], value, atol=1e-5)  # noqa: E731
    close("robot position", [0.3, -0.2])
    close("robot heading, cosine and sine", [math.cos(0.7), math.sin(0.7)])
    side, ahead = planar_scenes.turned(velocity[0, :2], -0.7)
    close("robot speed, forward and sideways", [ahead, side])
    close("robot turn rate / 2.5", [velocity[0, 2] / 2.5])
    close("region centre in the robot's frame", planar_scenes.turned([0.1, 0.55], -0.7))
    close("region centre", [0.4, 0.35])
    close("region size", [0.6, 0.7])
    for b, name in enumerate(BLOCKS):
        x, y, angle = pose[parts + b]
        close(f"{name}: centre in the robot's frame", local[b])
        close(f"{name}: centre", [x, y])
        close(f"{name}: offset to the region", [x - 0.4, y - 0.35])
        close(f"{name}: velocity", velocity[parts + b, :2])
        close(f"{name}: angle, cosine and sine", [math.cos(angle), math.sin(angle)])
        close(f"{name}: turn rate / 10", [velocity[parts + b, 2] / 10])
        close(f"{name}: inside the region", [float(b == 3)])
    assert ("finger opening" in seen) == (robot == "gripper")


@pytest.mark.parametrize("robot", ["gripper", "short"])
def test_names_of_xmagicals_vector_tell_what_its_numbers_are(robot):
    scene, parts = _scene(robot, base=(0.3, -0.2, 0.7))
    seen = _named("xmagical", scene, parts, robot)
    for b, name in enumerate(BLOCKS):
        xy, block = np.asarray(scene.pose)[parts + b, :2], f"block {b + 1} ({name})"
        reach, goal = (math.dist(xy, p) / 2.8284271 for p in ((0.3, -0.2), (0.4, 0.35)))
        np.testing.assert_allclose(seen[f"{block} centre"], xy)
        np.testing.assert_allclose(seen[f"{block} distance to robot / diagonal"], reach, rtol=1e-5)
        np.testing.assert_allclose(seen[f"{block} distance to region / diagonal"], goal, rtol=1e-5)


@pytest.mark.parametrize(
    ("inside", "base", "first"),
    [
        ((0, 0), (-0.5, 0.6), 1),
        ((0, 0), (0.7, -0.5), 0),
        ((0, 1), (-0.5, 0.6), 0),
        ((1, 0), (0.7, -0.5), 1),
    ],
)
def test_sorted_targets_come_outside_first_and_nearest_first(inside, base, first):
    """The star starts at the lower right, the square at the upper left."""
    scene, parts = _scene("gripper", base=(*base, 0.4), seed=1)
    scene = scene._replace(inside=jnp.array([*inside, 0, 1, 0], bool))
    seen, plain = (_named(kind, scene, parts, "gripper") for kind in ("sorted", "rich"))
    for place, block in enumerate((first, 1 - first), start=1):
        for what in ("centre", "centre in the robot's frame", "velocity", "inside the region"):
            ours, its = seen[f"target {place} in turn: {what}"], plain[f"{BLOCKS[block]}: {what}"]
            np.testing.assert_array_equal(ours, its)
        assert seen[f"target {place} in turn is {BLOCKS[block]}"] == [1]
        assert seen[f"target {place} in turn is {BLOCKS[1 - block]}"] == [0]
    for name in set(plain) & set(seen):
        np.testing.assert_array_equal(seen[name], plain[name])


@pytest.mark.parametrize("kind", observations.OBSERVATIONS)
@pytest.mark.parametrize("robot", ["gripper", "short"])
@pytest.mark.parametrize(("count", "targets"), [(1, 1), (2, 2), (5, 2), (5, 5), (7, 3)])
def test_there_is_one_name_for_each_number(kind, robot, count, targets):
    parts = 3 if robot == "gripper" else 1
    blocks = tuple(BLOCKS[i % 5] for i in range(count))
    some = jnp.ones((parts + count, 3))
    scene = Observed(some, some, GOAL, jnp.zeros(count, bool))
    seen = jax.eval_shape(
        lambda s: observations.observe(kind, s, parts=parts, targets=targets), scene
    )
    names = observations.names(kind, blocks, fingers=parts == 3, targets=targets)
    assert seen.shape == (len(names),)


def test_all_in_one_place_is_finite_with_a_finite_gradient():
    """Robot, blocks and region's centre coincide: distances are 0."""
    pose = jnp.zeros((8, 3)).at[:, :2].set(GOAL[:2])
    scene = Observed(pose, jnp.zeros((8, 3)), GOAL, jnp.ones(5, bool))
    for kind in observations.OBSERVATIONS:
        total = lambda p, k=kind: observations.observe(  # noqa: E731
            k, scene._replace(pose=p), parts=3, targets=2
        ).sum()
        assert np.isfinite(jax.jit(jax.grad(total))(pose)).all()
