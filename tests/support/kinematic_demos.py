"""Made-up demonstrations: blocks carried to a region, one after another, without a simulator."""

import numpy as np

from gril_jax.types import DemoBatch

GOAL, ROBOT, STAR, SQUARE = range(4)  # further labels are distractors
SIZES = np.array([[0.6, 0.7], [0.6, 0.6], *[[0.28, 0.28]] * 5])


def kinematic_demos(seed, num_demos, *, num_objects=7, max_length=120, jitter=None):
    """Blocks dragged along straight lines with wobble, in random order, then let go.

    Layouts are random, or with `jitter` one fixed layout moved by at most that much.
    """
    rng = np.random.default_rng(seed)
    center = np.zeros((num_demos, max_length, num_objects, 2), np.float32)
    length = np.zeros(num_demos, np.int32)
    for b in range(num_demos):
        frames = _one_demo(rng, _layout(rng, num_objects, jitter), num_objects)[:max_length]
        length[b] = len(frames)
        center[b, : len(frames)] = frames
        center[b, len(frames) :] = frames[-1]

    def tile(x):
        return np.broadcast_to(x, (num_demos, *np.shape(x)))

    return DemoBatch(
        center=center,
        size=np.tile(SIZES[:num_objects], (num_demos, max_length, 1, 1)).astype(np.float32),
        label=tile(np.arange(num_objects, dtype=np.int32)),
        is_robot=tile(np.arange(num_objects) == ROBOT),
        present=tile(np.ones(num_objects, bool)),
        length=length,
    )


def _layout(rng, num_objects, jitter):
    if jitter is not None:
        fixed = [(0.4, 0.35), (-0.5, 0.1), (0.8, -0.7), (-0.68, 0.72)]
        fixed += [(-0.05, -0.2), (-0.75, -0.55), (0.3, -0.82)]
        return np.array(fixed)[:num_objects] + rng.uniform(-jitter, jitter, (num_objects, 2))
    goal = rng.uniform(-0.7, 0.7, 2)
    places = [goal]
    while len(places) < num_objects:
        place = rng.uniform(-0.95, 0.95, 2)
        if (np.abs(place - goal) > [0.45, 0.5]).any():  # nothing begins in the region
            places.append(place)
    return np.array(places)


def _one_demo(rng, place, num_objects):
    frames, place = [place.copy()], place.copy()

    def travel(moving, target, speed):  # world units per frame
        distance = np.linalg.norm(target - place[moving[0]])
        steps = max(2, int(distance / (speed * rng.uniform(0.75, 1.25))))
        start = place[moving].copy()
        for share in np.linspace(0, 1, steps + 1)[1:]:
            wobble = rng.normal(0, 0.01, 2) * (share < 1)
            place[moving] = start + share * (target - start[0]) + wobble
            frames.append(place.copy())

    for slot, block in enumerate(rng.permutation([STAR, SQUARE])):
        travel([ROBOT], place[block] + rng.normal(0, 0.02, 2), 0.08)
        if num_objects > 4 and rng.random() < 0.25:  # a distractor is bumped on the way
            bumped = rng.integers(4, num_objects)
            place[bumped] += rng.normal(0, 0.05, 2)
            frames.append(place.copy())
        place[ROBOT] = place[block]
        spot = place[GOAL] + [0.0, (-0.15, 0.15)[slot]] + rng.uniform(-0.08, 0.08, 2)
        travel([block, ROBOT], spot, 0.045)
    return np.array(frames, np.float32)
