"""The robots' masses and shapes are the specification's."""

import math

import numpy as np
import pytest
from gril_jax.envs.planar import robots
from support import planar_scenes

OPEN = robots.FINGER_OPEN


def _finger(side, opening):
    """Outline of a finger in the base's frame; side 0 is the left."""
    part, sign = robots.robot("gripper").parts[1 + side], (1, -1)[side]
    return planar_scenes.turned(part.outline, sign * opening) + robots.PIVOTS[side]


def _gap(opening):
    """Smallest distance between the corners of both fingers' forearms."""
    left, right = _finger(0, opening), _finger(1, opening)
    ahead = 0.25  # the forearms' ends
    left, right = left[left[:, 1] > ahead], right[right[:, 1] > ahead]
    return np.linalg.norm(left[:, None] - right, axis=-1).min()


def test_fingers_leave_the_references_gap():
    assert _gap(OPEN) == pytest.approx(0.29, abs=0.01)
    assert _gap(0.0) == pytest.approx(0.03, abs=0.01)


def test_the_farthest_corner_of_a_finger_is_where_the_reference_has_it():
    for side in (1, 2):
        finger = robots.robot("gripper").parts[side]
        assert finger.outline[:, 1].max() == pytest.approx(0.349, abs=1e-3)
        assert finger.corners[:, 1].max() == pytest.approx(0.349, abs=1e-3)


@pytest.mark.parametrize("opening", [0.0, 0.2, OPEN])
def test_fingers_mirror_each_other(opening):
    left, right = _finger(0, opening), _finger(1, opening)
    np.testing.assert_allclose(left * [-1, 1], right, atol=1e-12)


def test_forearms_bend_inwards():
    tip = _finger(0, 0.0)[:, 1].argmax()
    assert _finger(0, 0.0)[tip, 0] > robots.PIVOTS[0, 0]


def test_boxes_of_a_finger_have_the_specified_sides():
    for side in (1, 2):
        upper, fore = robots.robot("gripper").parts[side].boxes
        np.testing.assert_allclose(2 * np.array(upper.half), [0.05, 0.22])
        np.testing.assert_allclose(2 * np.array(fore.half), [0.05, 0.14])
        assert abs(fore.angle) == pytest.approx(math.pi / 8)
        assert upper.angle == 0


def test_outline_of_a_finger_is_the_rim_of_its_two_boxes():
    """Each outline corner lies on a box's rim or in the other box; both boxes lie inside it."""
    for side in (1, 2):
        part = robots.robot("gripper").parts[side]
        for point in part.outline:
            inside = []
            for box in part.boxes:
                local = planar_scenes.turned(point - np.array(box.center), -box.angle)
                inside.append((np.abs(local) - box.half).max())
            assert min(inside) == pytest.approx(0.0, abs=1e-9)


def test_masses_and_inertias_are_the_references():
    gripper = robots.robot("gripper")
    assert sum(p.mass for p in gripper.parts) == pytest.approx(1.25)
    # Of the fingers as the original's engine computes them, which gives the left one more.
    inertias = [p.inertia for p in gripper.parts]
    assert inertias == pytest.approx([0.020, 0.00500649436186835, 0.004983019517209478], rel=1e-9)
    assert [p.friction for p in gripper.parts] == [0.5, 5.0, 5.0]
    assert gripper.has_fingers
    for name, inertia in (("short", 0.00833), ("medium", 0.03083), ("long", 0.21417)):
        stick = robots.robot(name)
        (part,) = stick.parts
        assert (part.mass, part.friction) == (1.0, 0.5)
        assert part.inertia == pytest.approx(inertia, abs=5e-6)
        assert not stick.has_fingers


@pytest.mark.parametrize(("name", "width"), [("short", 0.3), ("medium", 0.6), ("long", 1.6)])
def test_sticks_are_boxes_across_the_way_whose_inertia_is_a_boxs(name, width):
    (part,) = robots.robot(name).parts
    np.testing.assert_allclose(np.ptp(part.outline, axis=0), [width, 0.1])
    assert part.inertia == pytest.approx((width**2 + 0.1**2) / 12, rel=1e-3)


def test_every_robot_has_its_name():
    assert [robots.robot(name).name for name in robots.ROBOTS] == list(robots.ROBOTS)
