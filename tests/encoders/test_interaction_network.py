"""The interaction network against a plain loop over pairs in float64, in its published variants,
and GraphIRL's node features."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.graph_frames import NUM_CLASSES, random_frame

from gril_jax.encoders import encoder
from gril_jax.encoders.box_mlp import box_features, class_distances
from gril_jax.encoders.encoder import InteractionConfig, MLPConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs.scene import scene_graph

XMAGICAL = InteractionConfig(NUM_CLASSES, width=6, length_unit=0.5)
ROBOT = dataclasses.replace(XMAGICAL, distances=True)
apply = jax.jit(encoder.apply)


def _params(config, seed=0):
    """Every array drawn at random: fresh biases are zero and hide mistakes."""
    shapes = jax.eval_shape(lambda key: encoder.init(key, config), jax.random.key(0))
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape), jnp.float32), shapes)


def _features(frame, config, robot):
    f = {k: np.asarray(v) for k, v in frame.items()}
    center, size = f["center"].astype(np.float64), f["size"].astype(np.float64)
    rows = []
    for i in range(len(center)):
        x = [*(center[i] - size[i] / 2), *(center[i] + size[i] / 2)]
        for kind in range(config.num_classes if config.distances else 0):
            js = [
                j
                for j in range(len(center))
                if f["label"][j] == kind
                and (j == i or (f["present"][j] and (robot or not f["is_robot"][j])))
            ]
            x.append(min((np.linalg.norm(center[i] - center[j]) for j in js), default=0.0))
        rows.append(np.array(x) / config.length_unit * f["present"][i])
    return np.array(rows)


def _oracle(params, frame, config):
    """One node and one pair at a time; each block whole."""
    p = jax.tree.map(lambda x: np.asarray(x, np.float64), params)
    f = {k: np.asarray(v) for k, v in frame.items()}
    x, width = _features(frame, config, config.robot_messages), config.width

    def block(x, w1, b1, w2, b2):
        hidden = np.maximum(x @ w1 + b1, 0)
        return hidden + hidden @ w2 + b2

    def self_block(i):
        kind = f["label"][i] if config.distances else int(f["is_robot"][i])
        mine = slice(kind * width, (kind + 1) * width)
        first, second = p["self"]["1"], p["self"]["2"]
        return block(
            x[i], first["kernel"][:, mine], first["bias"][mine], second["kernel"][mine],
            p["self"]["bias_2"][kind],
        )  # fmt: skip

    r = p["relation"]
    w1 = np.concatenate([r["1_receiver"]["kernel"], r["1_sender"]["kernel"]])
    latent, count = np.zeros(width), 0
    for i in range(len(x)):
        z = self_block(i)
        for j in range(len(x)):
            heard = f["present"][j] and (config.robot_messages or not f["is_robot"][j])
            if j != i and heard:
                pair = np.concatenate([x[i], x[j]])
                z = z + block(pair, w1, r["1_receiver"]["bias"], r["2"]["kernel"], r["bias_2"])
        one, two = p["affector_1"], p["affector_2"]
        z = block(z, one["kernel"], one["bias"], two["kernel"], two["bias"])
        if f["present"][i] and (config.pool_robot or not f["is_robot"][i]):
            latent, count = latent + z, count + 1
    return latent / count


@pytest.mark.parametrize("base", [XMAGICAL, ROBOT], ids=["xmagical", "robot"])
@pytest.mark.parametrize(("pool", "messages"), [(True, True), (False, True), (False, False)])
def test_latent_equals_the_loop_to_twelve_digits_in_float64(base, pool, messages):
    config = dataclasses.replace(base, pool_robot=pool, robot_messages=messages)
    params, frame = _params(config), random_frame()
    wanted = _oracle(params, frame, config)
    np.testing.assert_allclose(
        apply(params, scene_graph(**frame), config), wanted, rtol=1e-4, atol=1e-4
    )
    with jax.enable_x64(True):
        wide = jax.tree.map(
            lambda x: jnp.asarray(x, jnp.float64 if x.dtype == np.float32 else x.dtype),
            jax.tree.map(np.asarray, (params, frame)),
        )
        latent = encoder.apply(wide[0], scene_graph(**wide[1]), config)
        np.testing.assert_allclose(latent, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("config", [XMAGICAL, ROBOT, MLPConfig(NUM_CLASSES)],
                         ids=["xmagical", "robot", "mlp"])  # fmt: skip
def test_latent_ignores_node_order_and_absent_nodes(config):
    params, frame = _params(config), random_frame()
    latent = apply(params, scene_graph(**frame), config)
    order = jnp.array([3, 0, 4, 2, 1])
    shuffled = apply(params, scene_graph(**{k: v[order] for k, v in frame.items()}), config)
    np.testing.assert_allclose(shuffled, latent, rtol=1e-4, atol=1e-4)
    smaller = apply(params, scene_graph(**{k: v[:4] for k, v in frame.items()}), config)
    np.testing.assert_allclose(smaller, latent, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("base", [ROBOT, MLPConfig(NUM_CLASSES)], ids=["network", "mlp"])
def test_latent_depends_on_the_robot_unless_its_node_is_left_out(base):
    frame = random_frame()
    moved = frame | {"center": frame["center"].at[1].set(jnp.array([9.0, -7.0]))}
    out = {"pool_robot": False} | ({"robot_messages": False} if base is ROBOT else {})
    for config, same in ((base, False), (dataclasses.replace(base, **out), True)):
        params = _params(config)
        a, b = (apply(params, scene_graph(**f), config) for f in (frame, moved))
        assert np.array_equal(a, b) == same


def test_the_mlp_equals_numpy():
    config = MLPConfig(NUM_CLASSES, width=6, length_unit=0.5)
    params, frame = _params(config), random_frame()
    p = jax.tree.map(lambda x: np.asarray(x, np.float64), params)
    x = _features(frame, XMAGICAL, True)

    def dense(name, x):
        return np.maximum(x @ p[name]["kernel"] + p[name]["bias"], 0)

    hidden = np.concatenate([dense("agent", x[1]), dense("boxes", x[[0, 2, 3]]).mean(0)])
    np.testing.assert_allclose(
        apply(params, scene_graph(**frame), config), dense("latent", hidden), rtol=1e-4, atol=1e-4
    )


def test_fresh_parameters_scale_like_blocks_of_their_own():
    config = dataclasses.replace(ROBOT, width=256)
    fresh = encoder.init(jax.random.key(0), config)
    assert np.std(fresh["self"]["2"]["kernel"]) == pytest.approx(256**-0.5, rel=0.1)
    assert np.std(fresh["relation"]["1_sender"]["kernel"]) == pytest.approx(16**-0.5, rel=0.1)


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (InteractionConfig, "num_classes", 0),
        (InteractionConfig, "width", 0),
        (InteractionConfig, "length_unit", 0.0),
        (MLPConfig, "width", 3),
        (MLPConfig, "length_unit", -1.0),
    ],
)
def test_config_out_of_range_is_refused_by_name(kind, field, value):
    with pytest.raises(ConfigError, match=rf"encoder\.{field} is {value}"):
        kind(**({"num_classes": 4} | {field: value}))


def _nearest(center, label, counted, i, kind):
    found = [
        np.linalg.norm(center[i] - center[j])
        for j in range(len(label))
        if label[j] == kind and (counted[j] or j == i)
    ]
    return min(found, default=0.0)


@pytest.mark.parametrize("num_nodes", [0, 1, 7])
def test_distances_are_those_to_the_nearest_counted_object_of_each_class(num_nodes):
    frame = random_frame(1, num_nodes)
    counted = jnp.arange(num_nodes) % 3 != 0
    got = class_distances(frame["center"], frame["label"], counted, NUM_CLASSES)
    center, label = np.asarray(frame["center"], np.float64), np.asarray(frame["label"])
    wanted = [
        [_nearest(center, label, counted, i, kind) for kind in range(NUM_CLASSES)]
        for i in range(num_nodes)
    ]
    np.testing.assert_allclose(got, np.reshape(wanted, (-1, NUM_CLASSES)), rtol=1e-6)


def test_one_object_of_each_class_in_order_gives_the_distance_matrix():
    center = random_frame(2, 3)["center"]
    got = class_distances(center, jnp.arange(3), jnp.ones(3, bool), 3)
    wanted = np.linalg.norm(np.asarray(center)[:, None] - np.asarray(center), axis=-1)
    np.testing.assert_allclose(got, wanted, rtol=1e-6)


def test_gradient_of_distances_is_finite_where_centres_coincide():
    label = jnp.array([0, 1, 1])
    gradient = jax.grad(lambda c: class_distances(c, label, label > 0, 3).sum())(jnp.ones((3, 2)))
    assert np.isfinite(gradient).all()


def test_features_are_corners_then_distances_in_length_units_and_an_absent_object_has_none():
    frame, config = random_frame(3), InteractionConfig(NUM_CLASSES, distances=True, length_unit=2.0)
    found = box_features(scene_graph(**frame).nodes, config, robot=True)
    assert found.shape == (5, 4 + NUM_CLASSES)
    corner = (frame["center"] - frame["size"] / 2) / 2.0
    np.testing.assert_allclose(found[:4, :2], corner[:4], rtol=1e-6)
    apart = class_distances(frame["center"], frame["label"], frame["present"], NUM_CLASSES) / 2.0
    np.testing.assert_allclose(found[:4, 4:], apart[:4], rtol=1e-6)
    assert (found[4] == 0).all()
