"""The wheel holds what the repository tracks, under one name, and works on its own."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
from support.paths import REPOSITORY as ROOT

FOLDERS = {
    "gril_jax": "gril_jax",
    "envs": "gril_jax/envs",
    "configs": "gril_jax/configs",
    "experiments": "gril_jax/experiments",
}


def _tracked():
    """Tracked files, and new ones that git does not ignore, of the folders that are shipped."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *FOLDERS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        pytest.skip("the sources are not in a git checkout")
    shipped = (f for f in done.stdout.splitlines() if not f.startswith("experiments/results/"))
    return sorted(line for line in shipped if (ROOT / line).exists())


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """A copy of what a distribution is made of."""
    folder = tmp_path_factory.mktemp("sources")
    extra = ["pyproject.toml", "docs/package.md", "LICENSE"]
    for name in (*_tracked(), *extra):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, target)
    return folder


@pytest.fixture(scope="module")
def wheel(sources, tmp_path_factory):
    """A wheel built from a copy of the sources, without a network."""
    pytest.importorskip("setuptools", minversion="77")
    folder = tmp_path_factory.mktemp("wheel")
    build = "import setuptools.build_meta as b, sys; print(b.build_wheel(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", build, str(folder)], cwd=sources, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.splitlines()[-1]


def test_a_package_index_accepts_what_is_built(sources, tmp_path):
    """The archive of the sources, the wheel that is built from it, and how an index shows them."""
    for name in ("build", "twine"):
        pytest.importorskip(name, reason=f"{name} is not installed: pip install -e '.[publish]'")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", tmp_path, sources]
    done = subprocess.run(build, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    built = sorted(tmp_path.iterdir())
    assert [file.suffix for file in built] == [".whl", ".gz"]
    check = [sys.executable, "-m", "twine", "check", "--strict", *built]
    done = subprocess.run(check, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    with zipfile.ZipFile(built[0]) as archive:
        found = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert found == _shipped()


def test_the_page_for_an_index_needs_no_other_file():
    text = (ROOT / "docs" / "package.md").read_text()
    assert re.findall(r"\]\((?!https?://)", text) == []


def _shipped():
    """Paths in the wheel of the tracked files."""
    parts = (name.partition("/") for name in _tracked())
    return {f"{FOLDERS[folder]}/{rest}" for folder, _, rest in parts}


def test_the_wheel_holds_the_tracked_files_and_no_others(wheel):
    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert found == _shipped()


def test_the_wheel_adds_one_name_and_one_command(wheel):
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
        info = next(top for top in tops if top.endswith(".dist-info"))
        assert tops == {"gril_jax", info}
        assert "gril = gril_jax.cli.main:main" in archive.read(f"{info}/entry_points.txt").decode()
        metadata = Parser().parsestr(archive.read(f"{info}/METADATA").decode())
    assert metadata["Name"] == "gril-jax"
    assert metadata["Requires-Python"] == "<3.14,>=3.11"


def test_the_wheel_works_without_the_checkout(wheel, tmp_path):
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    code = (
        "import sys\n"
        "sys.meta_path = [f for f in sys.meta_path if 'editable' not in str(f).lower()]\n"
        "import gril_jax, gril_jax.envs, gril_jax.config.files as c\n"
        "print(gril_jax.__file__, gril_jax.envs.__file__, c.load('quickstart').ppo.num_timesteps)\n"
    )
    paths = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    environment = os.environ | {"PYTHONPATH": paths, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    package, envs, steps = done.stdout.splitlines()[-1].split()
    assert Path(package).parent == site / "gril_jax"
    assert Path(envs).parent == site / "gril_jax" / "envs"
    assert steps == "10000000"


@pytest.mark.parametrize("name", ["envs", "configs", "experiments"])
def test_a_folder_is_not_importable_under_a_second_name(name):
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import {name}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert f"ImportError: import this package as gril_jax.{name}, not {name}" in done.stderr
