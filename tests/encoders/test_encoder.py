"""The paper's encoder against a plain loop over edges, what the latent may depend on, and what
all graph encoders share."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.graph_frames import awkward_frames, random_frame

from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig, InteractionConfig, MLPConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs.scene import scene_graph

CONFIG = EncoderConfig(num_classes=4, width=8, rounds=2, latent=5, length_unit=0.5)
init = jax.jit(encoder.init)
PARAMS = init(jax.random.key(0), CONFIG)
ROBOT, ABSENT = 1, 4


@jax.jit
def embed(params, frame, config, alpha=5.0):
    return encoder.apply(params, scene_graph(**frame), config, alpha=alpha)


def _frame(seed=0):
    """In NumPy, so that changes of it compile nothing."""
    return jax.tree.map(np.asarray, random_frame(seed, robot=ROBOT, absent=ABSENT))


def _latent(frame, config=CONFIG, alpha=5.0):
    return embed(PARAMS, frame, config, alpha)


@jax.jit
@jax.grad
def _slope(center, frame, weights):
    """Of a weighted sum of the latent, by the centres."""
    return _latent(frame | {"center": center}) @ weights


def relu(x):
    return np.maximum(x, 0)


def dense(part, name, x):
    return x @ part[name]["kernel"] + part[name].get("bias", 0)


def _oracle(frame, config, alpha):
    """The equations one node and one edge at a time, in float64."""
    p = jax.tree.map(lambda x: np.asarray(x, np.float64), PARAMS)
    f = {k: np.asarray(v) for k, v in frame.items()}
    num_nodes, unit = len(f["label"]), config.length_unit

    one_hot = np.eye(config.num_classes)[f["label"]]
    z = np.concatenate([one_hot, f["center"] / unit, f["size"] / unit], axis=1)
    z = dense(p["messages"], "Dense_0", z)
    for r in range(config.rounds):
        names = [f"Dense_{1 + 5 * r + i}" for i in range(5)]
        new = []
        for i in range(num_nodes):
            total = np.zeros(config.width)
            for j in range(num_nodes):
                muted = f["is_robot"][j] and not config.robot_messages
                if j == i or muted or not f["present"][j]:
                    continue
                offset = (f["center"][j] - f["center"][i]).astype(np.float64) / unit
                edge = np.append(offset, np.linalg.norm(offset))
                total += relu(
                    dense(p["messages"], names[0], z[j])
                    + dense(p["messages"], names[1], z[i])
                    + dense(p["messages"], names[2], edge)
                )
            hidden = relu(dense(p["messages"], names[3], np.concatenate([z[i], total])))
            new.append(z[i] + dense(p["messages"], names[4], hidden))
        z = np.array(new)
    w = np.where(f["active"], alpha, 1.0) * f["present"]
    if not config.pool_robot:
        w = w * ~f["is_robot"]
    pooled = (w[:, None] * z).sum(0) / w.sum()
    return dense(p["head"], "Dense_1", relu(dense(p["head"], "Dense_0", pooled)))


@pytest.mark.parametrize("pool_robot", [False, True])
@pytest.mark.parametrize("robot_messages", [False, True])
def test_latent_equals_the_loop(pool_robot, robot_messages):
    config = dataclasses.replace(CONFIG, pool_robot=pool_robot, robot_messages=robot_messages)
    latent = _latent(_frame(), config, alpha=3.0)
    np.testing.assert_allclose(latent, _oracle(_frame(), config, 3.0), rtol=1e-4, atol=1e-5)


def test_latent_equals_the_loop_to_twelve_digits_in_float64():
    with jax.enable_x64(True):
        params, frame = jax.tree.map(
            lambda x: np.asarray(x, np.float64 if x.dtype == np.float32 else x.dtype),
            (PARAMS, _frame()),
        )
        latent = embed(params, frame, CONFIG, 3.0)
        np.testing.assert_allclose(latent, _oracle(frame, CONFIG, 3.0), rtol=1e-12, atol=1e-12)


def test_latent_ignores_node_order():
    order = np.array([3, 0, 4, 2, 1])
    shuffled = {k: v[order] for k, v in _frame().items()}
    np.testing.assert_allclose(_latent(shuffled), _latent(_frame()), rtol=1e-4, atol=1e-6)


def _changed(frame, node):
    """The same frame with everything about one node changed but what kind of node it is."""
    changed = {name: value.copy() for name, value in frame.items()}
    changed["center"][node] = 9.0, -7.0
    changed["size"][node] = 3.0
    changed["label"][node] = (frame["label"][node] + 1) % 4
    changed["active"][node] = ~frame["active"][node]
    return changed


@pytest.mark.parametrize("node", [ROBOT, ABSENT])
def test_latent_does_not_depend_on_the_robot_nor_on_absent_nodes(node):
    np.testing.assert_array_equal(_latent(_changed(_frame(), node)), _latent(_frame()))
    gradient = _slope(_frame()["center"], _frame(), np.ones(5, np.float32))
    assert (gradient[node] == 0).all()
    assert (gradient[0] != 0).any()


@pytest.mark.parametrize("switch", ["pool_robot", "robot_messages"])
def test_latent_depends_on_the_robot_if_asked_to(switch):
    config = dataclasses.replace(CONFIG, **{switch: True})
    moved = _changed(_frame(), ROBOT)
    assert not np.allclose(_latent(moved, config), _latent(_frame(), config), atol=1e-4)


def test_alpha_changes_the_latent_only_if_some_but_not_all_nodes_are_active():
    for active in (False, True):
        frame = _frame() | {"active": np.full(5, active)}
        np.testing.assert_allclose(_latent(frame, alpha=9.0), _latent(frame), rtol=1e-4)
    frame = _frame() | {"active": np.arange(5) == 0}
    assert not np.allclose(_latent(frame, alpha=9.0), _latent(frame), atol=1e-4)


@jax.jit
@jax.value_and_grad
def _summed(params, frame):
    return embed(params, frame, CONFIG).sum()


def test_a_lone_object_and_a_lone_robot_have_finite_latents_and_gradients():
    for is_robot in (False, True):
        frame = {k: v[:1] for k, v in _frame().items()}
        frame["is_robot"] = np.array([is_robot])
        value, gradient = _summed(PARAMS, frame)
        assert np.isfinite(value)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(gradient))


def test_gradient_equals_finite_differences():
    frame, h = _frame(), np.float32(1e-3)
    direction = np.zeros((5, 2), np.float32)
    direction[0] = 0.6, 0.8

    def value(t):
        return _latent(frame | {"center": frame["center"] + t * direction})[0]

    numeric = (value(h) - value(-h)) / (2 * h)
    slope = np.asarray(_slope(frame["center"], frame, np.eye(5, dtype=np.float32)[0]))
    np.testing.assert_allclose((slope * direction).sum(), numeric, rtol=0.02, atol=1e-3)


def test_vmap_equals_a_loop_over_graphs_and_over_parameters():
    frames = [_frame(seed) for seed in range(3)]
    together = jax.tree.map(lambda *x: np.stack(x), *frames)
    batched = jax.vmap(embed, (None, 0, None))(PARAMS, together, CONFIG)
    for frame, latent in zip(frames, batched, strict=True):
        np.testing.assert_allclose(latent, _latent(frame), rtol=1e-4, atol=1e-5)

    keys = jax.random.split(jax.random.key(2), 2)
    params = jax.vmap(init, (0, None))(keys, CONFIG)
    batched = jax.vmap(embed, (0, None, None))(params, frames[0], CONFIG)
    alone = embed(init(keys[1], CONFIG), frames[0], CONFIG)
    np.testing.assert_allclose(batched[1], alone, rtol=1e-4, atol=1e-5)


def test_a_latent_does_not_depend_on_how_messages_are_summed():
    members = dataclasses.replace(CONFIG, ensemble_size=2)
    cases = (CONFIG, PARAMS), (members, jax.jit(encoder.init)(jax.random.key(3), members))
    for config, params in cases:

        @jax.jit
        def latents(params, frame, config=config):
            graph = scene_graph(**frame)
            forms = "dense", "square"
            return [encoder.apply(params, graph, config, form=form) for form in forms]

        np.testing.assert_allclose(*latents(params, _frame()), rtol=1e-4, atol=1e-5)


def test_parameters_are_plain_dicts_of_float32_arrays():
    assert type(PARAMS) is dict
    assert all(x.dtype == jnp.float32 for x in jax.tree.leaves(PARAMS))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("num_classes", 0),
        ("width", 0),
        ("rounds", -1),
        ("latent", 0),
        ("length_unit", 0.0),
        ("ensemble_size", 0),
    ],
)
def test_config_out_of_range_is_refused_by_name(field, value):
    with pytest.raises(ConfigError, match=rf"encoder\.{field} is {value}"):
        dataclasses.replace(CONFIG, **{field: value})


# --- all graph encoders

AWKWARD = [
    dataclasses.replace(CONFIG, robot_messages=True),
    InteractionConfig(4, width=6, distances=True, robot_messages=False),
    InteractionConfig(4, width=6),
    MLPConfig(4, width=6),
]


def _finite_as(config):
    """Value and gradients of a weighted latent, all finite? One program for each frame size."""

    def summed(params, floats, frame, alpha):
        latent = encoder.apply(params, scene_graph(**frame | floats), config, alpha=alpha)
        return jnp.sum(latent * jnp.arange(1, 1 + config.latent))

    def finite(params, frame, alpha):
        floats = {k: frame[k] for k in ("center", "size")}
        found = jax.value_and_grad(summed, argnums=(0, 1, 3))(params, floats, frame, alpha)
        return jnp.stack([jnp.isfinite(x).all() for x in jax.tree.leaves(found)]).all()

    return jax.jit(finite)


@pytest.mark.parametrize("config", AWKWARD, ids=["paper", "robot", "xmagical", "mlp"])
def test_awkward_graphs_of_any_size_have_finite_latents_and_gradients(config):
    params, finite = init(jax.random.key(0), config), _finite_as(config)

    @settings(max_examples=60, deadline=None)  # few sizes: each is compiled
    @given(st.sampled_from([0, 1, 7]).flatmap(awkward_frames), st.sampled_from([0.0, 5.0]))
    def check(frame, alpha):
        assert finite(params, frame, alpha)

    check()


@pytest.mark.parametrize("config", AWKWARD, ids=["paper", "robot", "xmagical", "mlp"])
def test_a_graph_of_nothing_is_embedded_alike_whether_empty_padding_or_uncounted_robots(config):
    params = init(jax.random.key(0), config)
    frames = [{k: v[:0] for k, v in _frame().items()}, _frame() | {"present": np.zeros(5, bool)}]
    latents = [embed(params, frame, config) for frame in frames]
    np.testing.assert_array_equal(*latents)


@pytest.mark.parametrize("config", AWKWARD, ids=["paper", "robot", "xmagical", "mlp"])
def test_whatever_padding_holds_the_latent_and_its_slope_are_the_same(config):
    params, frame = init(jax.random.key(0), config), _frame()
    both = jax.jit(jax.value_and_grad(lambda c, f: embed(params, f | {"center": c}, config).sum()))
    wanted = both(frame["center"], frame)
    for box in (np.nan, np.inf, 1e30):
        spoilt = {k: np.where(frame["present"][:, None], frame[k], box) for k in ("center", "size")}
        found = both(spoilt["center"], frame | spoilt)
        np.testing.assert_array_equal(found[0], wanted[0])
        np.testing.assert_array_equal(found[1], wanted[1])


def test_a_config_of_no_encoder_is_refused_by_name():
    for call in (encoder._module, encoder._node_module):
        with pytest.raises(
            ConfigError, match="encoder is a int; it must be one of EncoderConfig, "
        ):
            call(3)
    with pytest.raises(ConfigError, match="encoder is a MLPConfig, which does not embed nodes"):
        encoder._node_module(MLPConfig(4))


def test_every_graph_config_gives_a_latent_of_the_size_it_states():
    for config in AWKWARD:
        params = jax.eval_shape(lambda key, c=config: encoder.init(key, c), jax.random.key(0))
        latent = jax.eval_shape(embed, params, _frame(), config)
        assert latent.shape == (config.latent,)
        assert jax.tree.leaves(config) == []
