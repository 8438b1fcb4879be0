"""The pixel encoder against ResNet-18 written out in numpy, from torchvision's names; turns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.torchvision_weights import weights

from gril_jax.encoders import encoder, resnet
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.pretraining import batch
from gril_jax.types import DemoBatch

CONFIG = PixelConfig(latent=5)
apply, train = jax.jit(resnet.apply), jax.jit(resnet.apply_train)
FRAMES = jnp.asarray(np.random.default_rng(0).random((2, 3, 37, 50, 3)), jnp.float32)


@pytest.fixture(scope="module")
def params():
    """Random everything, statistics and scales too: the fresh ones hide mistakes."""
    fresh = jax.eval_shape(lambda key: resnet.init(key, CONFIG), jax.random.key(0))
    rng = np.random.default_rng(1)

    def drawn(path, x):
        name = path[-1].key
        low, high = {"scale": (0.5, 1), "var": (0.5, 2)}.get(name, (-0.1, 0.1))
        if name == "kernel":
            high = np.sqrt(3 * 2 / np.prod(x.shape[:-1]))  # variance 2 / inputs
            low = -high
        return jnp.asarray(rng.uniform(low, high, x.shape), jnp.float32)

    return jax.tree_util.tree_map_with_path(drawn, fresh)


# --- the oracle: float64, torchvision's names and layouts, channels first


def _conv(x, w, stride, pad):
    x = np.pad(x, ((0, 0), (0, 0), (pad, pad), (pad, pad)))
    windows = np.lib.stride_tricks.sliding_window_view(x, w.shape[2:], axis=(2, 3))
    windows = windows[:, :, ::stride, ::stride]
    return np.einsum("bihwkl,oikl->bohw", windows, w, optimize=True)


def _norm(w, name, x, seen):
    mean, var = w[f"{name}.running_mean"], w[f"{name}.running_var"]
    if seen is not None:
        mean, var = x.mean((0, 2, 3)), x.var((0, 2, 3))
        seen[name] = (mean, var)
    mean, var, scale, bias = (
        v[:, None, None] for v in (mean, var, w[f"{name}.weight"], w[f"{name}.bias"])
    )
    return (x - mean) / np.sqrt(var + 1e-5) * scale + bias


def _resnet(w, frames, seen=None):
    """`seen` gathers each normalisation's batch statistics, and makes them the ones used."""
    x = np.asarray(frames, np.float64).reshape(-1, *frames.shape[-3:]).transpose(0, 3, 1, 2)
    x = np.maximum(_norm(w, "bn1", _conv(x, w["conv1.weight"], 2, 3), seen), 0)
    x = np.pad(x, ((0, 0), (0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    x = np.lib.stride_tricks.sliding_window_view(x, (3, 3), axis=(2, 3))[:, :, ::2, ::2]
    x = x.max((-1, -2))
    for stage in range(1, 5):
        for block in range(2):
            name, stride = f"layer{stage}.{block}", 2 if stage > 1 and block == 0 else 1
            y = _norm(w, f"{name}.bn1", _conv(x, w[f"{name}.conv1.weight"], stride, 1), seen)
            y = _conv(np.maximum(y, 0), w[f"{name}.conv2.weight"], 1, 1)
            y = _norm(w, f"{name}.bn2", y, seen)
            if f"{name}.downsample.0.weight" in w:
                x = _conv(x, w[f"{name}.downsample.0.weight"], stride, 0)
                x = _norm(w, f"{name}.downsample.1", x, seen)
            x = np.maximum(x + y, 0)
    return x.mean((2, 3)) @ w["head.weight"].T + w["head.bias"]


def test_evaluation_equals_numpy_with_the_running_statistics(params):
    latents = apply(params, FRAMES, CONFIG)
    assert latents.shape == (2, 3, 5)
    wanted = _resnet(weights(params), FRAMES).reshape(2, 3, 5)
    np.testing.assert_allclose(latents, wanted, rtol=1e-4, atol=1e-4)


def test_training_equals_numpy_with_the_statistics_of_all_frames(params):
    latents, moved = train(params, FRAMES, CONFIG)
    seen: dict = {}
    wanted = _resnet(weights(params), FRAMES, seen)
    np.testing.assert_allclose(latents.reshape(6, 5), wanted, rtol=1e-3, atol=1e-3)
    for key in ("mean", "var"):
        old = params["statistics"]["layer2_0"]["downsample_1"][key]
        new = moved["statistics"]["layer2_0"]["downsample_1"][key]
        batch = seen["layer2.0.downsample.1"][key == "var"]
        np.testing.assert_allclose(new, 0.9 * old + 0.1 * batch, rtol=1e-3, atol=1e-4)
    assert moved["weights"] is params["weights"] or jax.tree.all(
        jax.tree.map(lambda a, b: bool((a == b).all()), moved["weights"], params["weights"])
    )


def test_the_trunk_has_the_published_number_of_parameters():
    fresh = jax.eval_shape(lambda key: resnet.init(key, PixelConfig()), jax.random.key(0))
    count = {k: sum(x.size for x in jax.tree.leaves(v)) for k, v in fresh["weights"].items()}
    assert count == {"trunk": 11_176_512, "head": 512 * 32 + 32}


def test_a_frame_is_embedded_alone_as_in_a_batch_but_not_in_training(params):
    alone = apply(params, FRAMES[0, 1], CONFIG)
    np.testing.assert_allclose(alone, apply(params, FRAMES, CONFIG)[0, 1], rtol=1e-4, atol=1e-5)
    assert not np.allclose(train(params, FRAMES, CONFIG)[0][0, 1], alone, atol=1e-2)


def test_strides_divide_the_image_by_32():
    found = jax.eval_shape(
        lambda x: resnet._Trunk().init_with_output(
            jax.random.key(0), x, train=False, capture_intermediates=True, mutable=True
        )[1]["intermediates"],
        jnp.zeros((1, 112, 96, 3)),
    )
    sizes = [found[f"layer{s}_1"]["__call__"][0].shape for s in range(1, 5)]
    assert sizes == [(1, 28, 24, 64), (1, 14, 12, 128), (1, 7, 6, 256), (1, 4, 3, 512)]


def test_gradients_are_finite_and_leave_the_statistics_alone(params):
    def loss(params):
        return jnp.sum(jnp.square(resnet.apply_train(params, same, CONFIG)[0]))

    same = jnp.full((2, 8, 8, 3), 0.5)  # equal frames, and one pixel in the last stages
    gradient = jax.jit(jax.grad(loss))(params)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(gradient))
    assert all((x == 0).all() for x in jax.tree.leaves(gradient["statistics"]))
    assert any((x != 0).any() for x in jax.tree.leaves(gradient["weights"]))


@pytest.fixture
def one_stage(monkeypatch):
    """The whole network takes long to compile."""
    monkeypatch.setattr(resnet, "STAGES", ((8, 2),))


def test_half_precision_finds_nearly_the_same_with_parameters_of_full(one_stage):
    full, half = PixelConfig(5, pixels=32), PixelConfig(5, pixels=32, precision="bfloat16")
    rng = np.random.default_rng(0)
    bright = rng.random((6, 1, 1, 3)) + 0.2 * rng.random((6, 32, 32, 3))
    frames, weights = jnp.asarray(bright, jnp.float32), jnp.asarray(rng.normal(size=(6, 5)))

    def found(params, config):
        def loss(params):
            latents, moved = resnet.apply_train(params, frames, config)
            return jnp.sum(weights * latents), (latents, moved["statistics"])

        (_, (trained, moved)), slope = jax.value_and_grad(loss, has_aux=True)(params)
        return resnet.apply(params, frames, config), trained, moved, slope["weights"]

    @jax.jit
    def both(key):
        fresh = resnet.init(key, half)
        return fresh, [found(fresh, config) for config in (full, half)]

    fresh, (exact, near) = both(jax.random.key(0))
    assert {x.dtype.name for x in jax.tree.leaves((fresh, exact, near))} == {"float32"}
    for a, b in zip(exact[:2], near[:2], strict=True):  # latents, in use and in training
        assert 0 < np.linalg.norm(a - b) < 0.03 * np.linalg.norm(a - a.mean(0))
    statistics, slopes = (
        [np.concatenate([x.ravel() for x in jax.tree.leaves(one[i])]) for one in (exact, near)]
        for i in (2, 3)
    )
    np.testing.assert_allclose(*statistics, rtol=1e-2, atol=1e-3)
    assert np.isfinite(slopes[1]).all()
    cosine = slopes[0] @ slopes[1] / np.linalg.norm(slopes[0]) / np.linalg.norm(slopes[1])
    assert cosine > 0.98  # the rest is where a rounding switches a rectifier over


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_precision_is_that_of_the_convolutions_alone(precision):
    config = PixelConfig(5, precision=precision)
    fresh = jax.eval_shape(lambda key: resnet.init(key, config), jax.random.key(0))
    frames = jax.ShapeDtypeStruct((1, 32, 32, 3), jnp.float32)
    program = jax.make_jaxpr(lambda p, x: resnet.apply(p, x, config))(fresh, frames)
    made = [(str(line.primitive), line.outvars[0].aval.dtype.name) for line in program.eqns]
    assert made.count(("conv_general_dilated", precision)) == 20
    assert {kind for name, kind in made if name in ("dot_general", "rsqrt")} == {"float32"}


def test_the_common_interface_takes_frames(params):
    latents = jax.jit(encoder.apply)(params, FRAMES[0], CONFIG, alpha=2.0)
    np.testing.assert_allclose(latents, apply(params, FRAMES[0], CONFIG), rtol=1e-4, atol=1e-5)
    with pytest.raises(ConfigError, match="does not embed nodes"):
        encoder._node_module(CONFIG)


@pytest.mark.parametrize("shape", [(3,), (8, 3), (8, 8, 4), (0, 8, 8, 3), (0, 8, 3)])
def test_frames_of_another_shape_are_refused(params, shape):
    with pytest.raises(ShapeError, match=r"frames has shape .* \(\.\.\., height, width, 3\)"):
        resnet._flat(jnp.zeros(shape), CONFIG)


def test_integer_frames_are_refused():
    with pytest.raises(ShapeError, match=r"frames has type uint8; .* RGB in \[0, 1\]"):
        resnet._flat(jnp.zeros((4, 4, 3), jnp.uint8), CONFIG)


def test_latent_below_one_is_refused():
    with pytest.raises(ConfigError, match=r"encoder\.latent is 0"):
        PixelConfig(latent=0)


SIDE = 9


def _marked(center):
    """Videos (V, F, P, P, 3) that are black but for a pixel at a point in [-1, 1] (V, F, 2)."""
    column = np.rint((center[..., 0] + 1) / 2 * (SIDE - 1)).astype(int)
    row = np.rint((1 - center[..., 1]) / 2 * (SIDE - 1)).astype(int)
    frames = np.zeros((*center.shape[:2], SIDE, SIDE, 3), np.uint8)
    for v, f in np.ndindex(center.shape[:2]):
        frames[v, f, row[v, f], column[v, f]] = (10, 20, 30)
    return jnp.asarray(frames)


def _boxes(center):
    videos, frames, _ = center.shape
    return DemoBatch(
        center=jnp.asarray(center[:, :, None], jnp.float32),
        size=jnp.full((videos, frames, 1, 2), 0.1),
        label=jnp.zeros((videos, 1), int),
        is_robot=jnp.zeros((videos, 1), bool),
        present=jnp.ones((videos, 1), bool),
        length=jnp.full(videos, frames),
    )


def test_frames_are_turned_as_the_boxes_are_from_the_same_key():
    rng = np.random.default_rng(0)
    center = rng.integers(-4, 5, (40, 3, 2)) / 4  # on the grid of pixels
    key = jax.random.key(1)
    turned = batch.turn(key, _boxes(center))
    found = resnet.turn(key, _marked(center))
    np.testing.assert_array_equal(found, _marked(np.asarray(turned.center)[:, :, 0]))


def test_all_eight_symmetries_come_up_and_each_holds_for_a_whole_video():
    frames = jax.random.randint(jax.random.key(0), (1, 1, 5, 5, 3), 0, 256).astype(jnp.uint8)
    same = jnp.tile(frames, (200, 2, 1, 1, 1))
    found = np.asarray(jax.jit(resnet.turn)(jax.random.key(2), same))
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    kinds = {video.tobytes() for video in found[:, 0]}
    square = np.asarray(frames)[0, 0]
    wanted = {
        np.ascontiguousarray(np.rot90(image, k)).tobytes()
        for image in (square, square[:, ::-1])
        for k in range(4)
    }
    assert kinds == wanted
    assert len(wanted) == 8
