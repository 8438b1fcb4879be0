"""The tasks of known returns against MuJoCo itself, and the comparison on them."""

import json

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.experiments.bench import frame
from gril_jax.experiments.bench.gymnasium_tasks import InvertedPendulum, Reacher
from gril_jax.experiments.bench.known import GROUND
from gril_jax.experiments.bench.pendulum import SacSetting

from gril_jax.errors import RunError


def _walk(task, actions, nudge):
    """Our states under some actions, and MuJoCo's positions and velocities under the same."""
    begun = jax.jit(task.reset)(jax.random.key(0))
    position, velocity, *rest = begun.data
    begun = begun._replace(data=(position + nudge, velocity, *rest))
    state, step, ours = begun, jax.jit(task.step), []
    for action in actions:
        state = step(state, jnp.asarray(action, jnp.float32))
        ours.append(jax.device_get(state))
    data = mujoco.MjData(task.mj_model)
    data.qpos, data.qvel = begun.data[:2]
    theirs = []
    for action in actions:
        data.ctrl = np.clip(action, -1, 1) * (3 if isinstance(task, InvertedPendulum) else 1)
        mujoco.mj_step(task.mj_model, data, 2)
        theirs.append((data.qpos.copy(), data.qvel.copy()))
    return begun, ours, theirs, data


@pytest.mark.slow
def test_the_pole_falls_as_in_mujoco_and_ends_the_episode():
    task = InvertedPendulum()
    np.testing.assert_allclose(task.mj_model.body_mass[1:], [10.47, 5.02], atol=0.01)
    begun, ours, theirs, _ = _walk(task, [[-0.5], [0.2], [-2.0], [0.0]], np.array([0.0, 0.15]))
    for state, (position, velocity) in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(state.obs, [*position, *velocity], atol=1e-4)
        leans = abs(position[1]) > 0.2
        assert (state.reward, state.done) == (1.0 - leans, leans)
        np.testing.assert_allclose(
            state.objects.center[1] - state.objects.center[0],
            0.6 * np.array([np.sin(position[1]), np.cos(position[1])]), atol=1e-5,
        )  # fmt: skip
    assert [float(state.done) for state in ours] == sorted(float(s.done) for s in ours)
    assert (begun.done, ours[-1].done) == (0, 1)


@pytest.mark.slow
def test_the_arm_moves_as_in_mujoco_and_pays_for_distance_and_effort():
    actions = [[1.0, -2.0], [-0.3, 0.5], [0.1, 0.9]]
    begun, ours, theirs, data = _walk(Reacher(), actions, np.zeros(2))
    target = begun.data[2]
    for state, action, (position, velocity) in zip(ours, actions, theirs, strict=True):
        tip = state.objects.center[1]
        np.testing.assert_allclose(state.obs[:2], np.cos(position), atol=1e-4)
        np.testing.assert_allclose(state.obs[2:4], np.sin(position), atol=1e-4)
        np.testing.assert_allclose(state.obs[6:8], velocity, rtol=1e-4)
        np.testing.assert_allclose(state.obs[8:], tip - target, atol=1e-6)
        pay = -np.linalg.norm(tip - target) - np.sum(np.clip(action, -1, 1) ** 2)
        np.testing.assert_allclose(state.reward, pay, rtol=1e-5)
        assert state.done == 0
    mujoco.mj_kinematics(Reacher().mj_model, data)
    np.testing.assert_allclose(tip, data.geom_xpos[-1, :2], atol=1e-5)


def test_targets_fill_the_disc_evenly():
    state = jax.jit(jax.vmap(Reacher().reset))(jax.random.split(jax.random.key(1), 4000))
    away = np.linalg.norm(state.data[2], axis=1)
    assert away.max() <= 0.2
    np.testing.assert_allclose(np.mean(away < 0.1), 0.25, atol=0.03)
    np.testing.assert_allclose(state.data[2].mean(0), 0, atol=0.01)


def test_each_ground_has_both_algorithms_and_a_source():
    for ground in GROUND.values():
        assert set(ground.settings) == set(ground.published) == {"ppo", "sac"}
        assert isinstance(ground.settings["sac"], SacSetting)
        assert all(known.source for known in ground.published.values())


def test_control_steps_cover_what_lies_between_two_evaluations():
    assert SacSetting(num_timesteps=1001, num_evals=3, num_envs=10).updates == 51


def test_both_sides_stand_beside_what_is_published():
    from gril_jax.experiments.bench.known import compared

    row = compared(
        "pendulum", "ppo", {"ours": {"returns": [-150.0, -154.0]}, "stock": {"returns": [-180.0]}}
    )
    assert row["mean_return"] == {"ours": -152.0, "stock": -180.0}
    assert row["above_published"] == {"ours": 20.2, "stock": -7.8}
    assert json.loads(json.dumps(row))["published"]["mean"] == -172.2


def test_every_task_algorithm_and_side_is_measured_once(monkeypatch):
    from gril_jax.experiments.bench import known as bench_known

    seen = []
    monkeypatch.setattr(bench_known, "_child", lambda x: seen.append(x) or {"returns": [len(x[2])]})
    options = {"tasks": ("reacher",), "algorithms": ("ppo", "sac"), "seeds": 2, "jobs": 2}
    rows = bench_known.main(**options)["rows"]
    assert len(seen) == len({*seen}) == 4
    assert [row["algorithm"] for row in rows] == ["ppo", "sac"]
    assert rows[1]["mean_return"] == {"ours": 4, "stock": 5}


def test_a_process_that_fails_is_one_sentence(monkeypatch):
    from gril_jax.experiments.bench import known as bench_known

    monkeypatch.setattr(frame, "_CHILD", "raise SystemExit('no memory left')")
    with pytest.raises(RunError, match="ppo of ours on pendulum failed: no memory left"):
        bench_known._child(("pendulum", "ppo", "ours", 1))
