"""Public names of `gril_jax` and its rooms, and the cost of importing them."""

import importlib
import pkgutil
import subprocess
import sys

import pytest

import gril_jax

PACKAGES = ["gril_jax"] + [
    f"gril_jax.{found.name}"
    for found in pkgutil.walk_packages(gril_jax.__path__)
    if found.ispkg and found.name not in ("envs", "configs", "experiments", "cli", "workflows")
]


def test_a_package_lists_its_names_and_has_them():
    for package in PACKAGES:
        module = importlib.import_module(package)
        assert module.__doc__
        for name in module.__all__:
            assert getattr(module, name) is not None, (package, name)
        assert len(set(module.__all__)) == len(module.__all__), package


def test_importing_loads_what_is_needed():
    """Nothing for the package itself, and JAX, Flax and Jraph alone for the room of rewards."""
    steps = (
        "import gril_jax; dir(gril_jax)",
        "import jax, jaxtyping, flax.linen, flax.struct, jraph, wadler_lindig",
        "import gril_jax.reward",
    )
    tell = "print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    code = "\n".join(["import sys", *(f"{step}\n{tell}" for step in steps)])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    bare, known, loaded = (set(line.split()) for line in done.stdout.splitlines())
    heavy = {"jax", "flax", "numpy", "brax", "mujoco", "orbax", "matplotlib", "yaml", "tyro"}
    assert "gril_jax" in bare
    assert not bare & heavy
    assert loaded == known


def test_what_users_import_is_where_they_have_it():
    from gril_jax import graphs, losses, reward, reward_file

    assert graphs.scene_graph is gril_jax.scene_graph
    assert reward.latent_goal_reward is gril_jax.latent_goal_reward
    assert reward_file.load_reward is gril_jax.load_reward is gril_jax.reward_file.load_reward
    for name in ("soft_dtw_between", "expected_alignment", "mean_cycle_consistency"):
        assert callable(getattr(losses, name))


def test_a_name_that_is_not_offered_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'lode_reward'"):
        gril_jax.lode_reward  # noqa: B018
