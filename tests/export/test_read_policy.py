"""A policy file is played as it was written, or refused in one sentence; by a module that stands
alone."""

import ast
import json
import re
import subprocess
import sys
import tracemalloc

import jax.numpy as jnp
import numpy as np
import pytest
from support.planted_faults import faults
from support.saved_policies import ABOUT, arrays, write

from gril_jax.export.read_policy import load_policy
from gril_jax.export.reward_format import packed
from gril_jax.graphs import activity


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "policy.npz"
    write(path)
    return path


def _refused(path):
    """The sentence with which a file is refused."""
    with pytest.raises(ValueError) as raised:  # noqa: PT011
        load_policy(path)
    text = str(raised.value)
    assert re.fullmatch(f"{path} is .*\\(.{{3,99}}\\): export it again", text), text
    return text


def test_the_action_is_that_of_the_layers_written_out(file):
    given, observation = arrays(), np.array([0.5, -9.0, 9.0])
    x = np.clip(observation - given["observation_mean"], -4, 4) @ given["kernel_0"]
    x = x + given["bias_0"]
    x = np.tanh(x / (1 + np.exp(-x)) @ given["kernel_1"] + given["bias_1"])
    wanted = np.tanh((x @ given["kernel_2"] + given["bias_2"])[:2])
    act = load_policy(file)
    np.testing.assert_allclose(act(observation), wanted, rtol=1e-5)
    np.testing.assert_allclose(act(np.stack([observation] * 7))[3], wanted, rtol=1e-5)


@pytest.mark.parametrize(
    "more", [{}, {"smoothing": 3, "noise": 0.004}, {"smoothing": 5, "noise": None}]
)
def test_an_episode_sees_the_activity_bits_that_training_sees(more, tmp_path):
    rule = {"objects": ["green square"], "tau": 0.1, "window": 3, "start": 2, "stop": 3} | more
    (tmp_path / "policy.npz").write_bytes(packed(arrays(), json.dumps(ABOUT | {"activity": rule})))
    policy, drawn = load_policy(tmp_path / "policy.npz"), np.random.default_rng(3)
    pushed = 0.02 * np.maximum(np.arange(12) - 4, 0)[:, None, None]
    center = (pushed + drawn.normal(0, 0.004, (12, 1, 2))).astype(np.float32)
    center[3] = np.nan  # lost for a frame
    size, own = np.full((12, 1, 2), 0.3, np.float32), drawn.normal(size=(12, 2))
    options = {"tau": 0.1, "window": 3} | more
    bits = activity.trajectory(jnp.asarray(center), jnp.asarray(size), **options)
    assert 0 < bits.sum() < 12
    act = policy.episode()
    for t in range(12):
        wanted = policy(np.concatenate([own[t], np.asarray(bits[t], float)]))
        np.testing.assert_array_equal(act(own[t], center[t], size[t]), wanted)
    with pytest.raises(ValueError, match=r"the 1 boxes of \['green square'\]"):
        act(own[0])


@pytest.mark.parametrize("shape", [(), (1,), (2,), (3, 1)])
def test_an_observation_of_another_size_is_not_broadcast(file, shape):
    with pytest.raises(ValueError, match=r"its last axis must be 3"):
        load_policy(file)(np.zeros(shape))


def test_planted_faults_are_refused_in_one_sentence_and_little_memory(file, tmp_path):
    whole, trap = file.read_bytes(), tmp_path / "unpickled"
    tried = 0
    for name, damaged in faults(whole, trap):
        path = tmp_path / "planted.npz"
        path.write_bytes(damaged)
        tracemalloc.start()
        _refused(path)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 8 * len(damaged) + 500_000, name
        tried += 1
    assert tried > 90
    assert not trap.exists()


def test_every_single_byte_is_under_the_digest(file):
    whole = file.read_bytes()
    for place in range(0, len(whole), 97):
        changed = bytearray(whole)
        changed[place] ^= 1
        file.write_bytes(changed)
        _refused(file)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"format": "gril-jax reward"}, "it holds a gril-jax reward, version 2"),
        ({"version": 3}, "it holds a gril-jax policy, version 3"),
        ({"layers": []}, "list index"),
        ({"layers": ABOUT["layers"][:2]}, "shapes"),
        ({"layers": [ABOUT["layers"][0] | {"activation": "gelu"}]}, "no known activation"),
        ({"layers": [ABOUT["layers"][0] | {"in": 10**30}]}, "shapes"),
        ({"layers": [ABOUT["layers"][i] for i in (0, 2, 1)]}, "layer 1 does not fit"),
        ({"output": {"mean": [0, 5], "squash": "tanh"}}, "no such output"),
        ({"output": {"mean": [0.0, 2.0], "squash": "tanh"}}, "no such output"),
        ({"output": {"mean": [0, 2], "squash": "none"}}, "no known function"),
        ({"output": None}, "not subscriptable"),
    ],
)
def test_a_description_that_makes_no_policy_is_refused(file, changed, text):
    file.write_bytes(packed(arrays(), json.dumps(ABOUT | changed)))
    assert re.search(text, _refused(file))


def test_the_reader_out_of_the_file_plays_it_with_nothing_but_numpy(file):
    with np.load(file) as content:
        reader = json.loads(str(content["description"]))["reader"]
    (file.parent / "read_policy.py").write_text(reader, encoding="utf-8")
    code = (
        "import sys\n"
        "from read_policy import load_policy\n"
        "print(*load_policy('policy.npz')([1, 2, 3]))\n"
        "print({'jax', 'gril_jax'} & {*sys.modules})\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=file.parent, text=True,
                          capture_output=True)  # fmt: skip
    action, loaded = done.stdout.splitlines()
    np.testing.assert_allclose([*map(float, action.split())], load_policy(file)([1, 2, 3]), 1e-6)
    assert loaded == "set()"


def test_the_reader_imports_numpy_and_the_standard_library_alone():
    found = set()
    for node in ast.walk(ast.parse(ABOUT["reader"])):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.add(node.module.split(".")[0])
    assert found - sys.stdlib_module_names == {"numpy"}
