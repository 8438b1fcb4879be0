"""Weights files: what is written is read, under torchvision's names; what is wrong is named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import pixel_encoder, pixel_weights
from gril_jax.encoder import PixelConfig
from gril_jax.errors import ConfigError, ShapeError

CONFIG = PixelConfig(latent=4)


def _params(seed, config=CONFIG):
    """Of the right shapes; drawn by numpy, since a real start takes long to compile."""
    shapes = jax.eval_shape(lambda key: pixel_encoder.init(key, config), jax.random.key(0))
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda x: jnp.asarray(rng.random(x.shape), x.dtype), shapes)


@pytest.fixture(scope="module")
def params():
    return _params(0)


@pytest.fixture(scope="module")
def arrays(params, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "no suffix"
    pixel_weights.save(path, params)
    with np.load(path) as file:
        return dict(file)


def _load(folder, arrays, config=CONFIG):
    np.savez(folder / "w.npz", **arrays)
    return pixel_weights.load(folder / "w.npz", _params(1, config), config)


def test_what_is_saved_is_loaded(params, arrays, tmp_path):
    loaded = _load(tmp_path, arrays)
    assert jax.tree.structure(loaded) == jax.tree.structure(params)
    for new, old in zip(jax.tree.leaves(loaded), jax.tree.leaves(params), strict=True):
        np.testing.assert_array_equal(new, old)


def test_names_and_shapes_are_torchvisions(arrays):
    shapes = {name: array.shape for name, array in arrays.items()}
    assert len(shapes) == 20 + 20 * 4 + 2
    assert shapes["conv1.weight"] == (64, 3, 7, 7)
    assert shapes["bn1.running_var"] == (64,)
    assert shapes["layer3.0.conv1.weight"] == (256, 128, 3, 3)
    assert shapes["layer3.1.bn2.running_mean"] == (256,)
    assert shapes["layer4.0.downsample.0.weight"] == (512, 256, 1, 1)
    assert shapes["layer4.0.downsample.1.bias"] == (512,)
    assert shapes["head.weight"] == (4, 512)


def test_a_classifiers_file_loads_into_any_latent_and_keeps_the_fresh_head(arrays, tmp_path):
    trunk = {k: v for k, v in arrays.items() if not k.startswith("head")}
    extra = {"fc.weight": np.zeros((1000, 512)), "bn1.num_batches_tracked": np.array(3)}
    config = PixelConfig(latent=7)
    fresh = _params(1, config)
    loaded = _load(tmp_path, trunk | extra, config)
    np.testing.assert_array_equal(
        loaded["weights"]["head"]["kernel"], fresh["weights"]["head"]["kernel"]
    )
    kernel = loaded["weights"]["trunk"]["conv1"]["kernel"]
    np.testing.assert_array_equal(kernel, arrays["conv1.weight"].transpose(2, 3, 1, 0))


def test_a_missing_array_is_named(arrays, tmp_path):
    short = {k: v for k, v in arrays.items() if k != "layer2.1.bn1.running_var"}
    with pytest.raises(ConfigError, match=r"no array 'layer2\.1\.bn1\.running_var'"):
        _load(tmp_path, short)


def test_an_array_of_another_shape_is_named_with_both_shapes(arrays, tmp_path):
    with pytest.raises(ShapeError, match=r"head\.bias has shape \(4,\).*must be \(9,\)"):
        _load(tmp_path, arrays, PixelConfig(latent=9))
    flat = arrays | {"conv1.weight": np.zeros(3)}
    with pytest.raises(ShapeError, match=r"conv1\.weight has shape \(3,\).*\(64, 3, 7, 7\)"):
        _load(tmp_path, flat)


def test_numbers_that_are_not_finite_are_refused(arrays, tmp_path):
    with pytest.raises(ConfigError, match=r"bn1\.bias must be finite"):
        _load(tmp_path, arrays | {"bn1.bias": np.full(64, np.nan, np.float32)})


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 not a zip", b"hello"])
def test_a_file_that_is_no_npz_is_refused_by_name(params, tmp_path, content):
    path = tmp_path / "bad.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.npz cannot be read"):
        pixel_weights.load(path, params, CONFIG)
