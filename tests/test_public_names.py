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


def _loaded(code):
    """The top-level packages of others that a fresh process has loaded after some code."""
    tell = "import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{tell}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_lists_its_names_and_has_them(package):
    module = importlib.import_module(package)
    assert module.__doc__
    for name in module.__all__:
        assert getattr(module, name) is not None
    assert len(set(module.__all__)) == len(module.__all__)


def test_importing_the_package_loads_nothing():
    heavy = {"jax", "flax", "numpy", "brax", "mujoco", "orbax", "matplotlib", "yaml", "tyro"}
    assert not _loaded("import gril_jax") & heavy
    assert not _loaded("import gril_jax; dir(gril_jax)") & heavy


def test_the_reward_room_loads_jax_flax_and_jraph_alone():
    known = _loaded("import jax, jaxtyping, flax.linen, flax.struct, jraph")
    of_jaxtyping = {"wadler_lindig"}
    assert _loaded("import gril_jax.reward") - known - of_jaxtyping == {"gril_jax"}


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
