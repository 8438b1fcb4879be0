"""Each number of an observation is what its name says."""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame, about_z
from gril_jax.envs.tabletop import task as observations
from gril_jax.envs.tabletop.boxes import Boxes
from gril_jax.envs.tabletop.physics import Motion

from gril_jax import envs


def test_every_number_is_under_its_name():
    rng = np.random.default_rng(0)
    draw = lambda *shape: jnp.asarray(rng.normal(size=shape), jnp.float32)  # noqa: E731
    motion = Motion(draw(16), draw(15), draw(15))
    target, action, place = draw(8), draw(2), draw(2, 3)
    hand = Frame(draw(3), about_z(jnp.float32(0.3)))
    things = Boxes(place, about_z(jnp.array([0.0, 1.0])), draw(2, 3))
    reached = jnp.array([True, False])
    found = observations.observe(motion, target, hand, things, reached, action)
    names = observations.names(("cup", "lid"), ("open", "shut"), ("a", "b"), rates=6)
    assert len(names) == len(set(names)) == len(found)
    seen = dict(zip(names, np.asarray(found), strict=True))
    wanted = {
        "joint 3": motion.qpos[2], "opening": motion.qpos[7], "opening rate": motion.qvel[7],
        "joint 2 lead": target[1] - motion.qpos[1], "hand y": hand.position[1],
        "hand y axis x": -np.sin(0.3), "hand z axis z": 1.0,
        "lid z": place[1, 2] - hand.position[2], "lid x axis y": np.sin(1.0),
        "lid y axis x": -np.sin(1.0), "cup y axis y": 1.0, "rate 0": motion.qvel[9],
        "rate 5": motion.qvel[14], "reached open": 1.0, "reached shut": 0.0, "last b": action[1],
    }  # fmt: skip
    for name, value in wanted.items():
        np.testing.assert_allclose(seen[name], value, atol=1e-6, err_msg=name)


def test_only_a_rich_observation_tells_the_stages_that_have_been_reached():
    rich, plain = (envs.make("umbrella_out", observation=kind) for kind in ("rich", "plain"))
    told = {f"reached {stage}" for stage in rich.stage_names}
    assert {*rich.observation_names} - {*plain.observation_names} == told
    obs = jax.eval_shape(plain.reset, jax.random.key(0)).obs
    assert obs.shape == (plain.observation_size,) == (len(plain.observation_names),)
