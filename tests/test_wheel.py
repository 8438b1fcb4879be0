"""The wheel holds what the repository tracks, under one name, and works on its own; the locked
requirements are known by their digests."""

import json
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
    extra = ["pyproject.toml", "README.md", "LICENSE"]
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


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory):
    """A folder with the wheel's files, as they would be installed."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


WITHOUT_THE_CHECKOUT = (
    "import sys\nsys.meta_path = [f for f in sys.meta_path if 'editable' not in str(f).lower()]\n"
)


def _installed(site):
    """Environment variables with which Python finds the wheel's files."""
    paths = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    return os.environ | {"PYTHONPATH": paths, "JAX_PLATFORMS": "cpu"}


def test_the_wheel_works_without_the_checkout(site, tmp_path):
    code = WITHOUT_THE_CHECKOUT + (
        "import gril_jax, gril_jax.envs, gril_jax.config.files as c\n"
        "print(gril_jax.__file__, gril_jax.envs.__file__, c.load('quickstart').ppo.num_timesteps)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=_installed(site),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    package, envs, steps = done.stdout.splitlines()[-1].split()
    assert Path(package).parent == site / "gril_jax"
    assert Path(envs).parent == site / "gril_jax" / "envs"
    assert steps == "7000000"


PROJECTS = {"my_task": "my_task", "gymnax_task": "herd", "mjx_task": "slide"}


@pytest.mark.slow  # two minutes each
@pytest.mark.parametrize("project", PROJECTS)
def test_a_project_that_was_copied_out_learns_its_task(site, tmp_path, project):
    """From videos alone, with the wheel and nothing of the checkout."""
    task, own = PROJECTS[project], ROOT / "experiments" / "examples" / project
    for file in own.iterdir():
        if file.suffix in (".py", ".yaml", ".xml"):
            shutil.copy(file, tmp_path)
    assert sum(len(file.read_text().splitlines()) for file in tmp_path.iterdir()) < 150
    where = {"cwd": tmp_path, "capture_output": True, "text": True}
    options = {k: v for k, v in _installed(site).items() if k != "XLA_FLAGS"}  # the tests' own
    options |= {"XDG_STATE_HOME": str(tmp_path / "state")}

    def python(code, *args):
        line = [sys.executable, "-c", WITHOUT_THE_CHECKOUT + code, *args]
        done = subprocess.run(line, **where, env=options)
        assert done.returncode == 0, done.stderr[-2000:]

    gril = "from gril_jax.cli.main import main\nsys.exit(main(sys.argv[1:]))"
    films = ()
    if (tmp_path / "make_films.py").exists():
        python("sys.path.insert(0, '')\nimport runpy\nsys.argv = ['make_films.py']\n"
               "runpy.run_path('make_films.py', run_name='__main__')")  # fmt: skip
        films = ("--demos", "mine")
    python(gril, "train", f"{task}.yaml", "--task", f"{task}.py:make", *films, "--out", "run")
    found = json.loads((tmp_path / "run" / "results.json").read_text())
    assert found["success"] >= 0.9
    assert found["success_random"] < 0.1
    assert found["given"].startswith("task starts only: ")


@pytest.mark.parametrize("name", ["envs", "configs", "experiments"])
def test_a_folder_is_not_importable_under_a_second_name(name):
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import {name}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert f"ImportError: import this package as gril_jax.{name}, not {name}" in done.stderr


# --- requirements.lock

LOCK = (ROOT / "requirements.lock").read_text()
# name==version ; marker \, then the digests of its files
PINS = re.findall(r"^([\w.-]+)==(\S+)([^\\\n]*)((?: \\\n    --hash=\S+)*)\n", LOCK, re.MULTILINE)


def test_every_line_is_a_pin_with_the_digests_of_its_files():
    assert len(PINS) > 80
    for name, version, _, hashes in PINS:
        assert re.fullmatch(r"( \\\n    --hash=sha256:[0-9a-f]{64})+", hashes), (name, version)
    rest = re.sub(r"^([\w.-]+)==(\S+)([^\\\n]*)((?: \\\n    --hash=\S+)*)\n", "", LOCK, flags=re.M)
    assert rest == ""  # no index, path or option


def test_packages_of_compiled_code_have_files_for_several_platforms():
    most = {name: hashes.count("sha256:") for name, _, _, hashes in PINS}
    assert all(most[name] >= 10 for name in ("jaxlib", "numpy", "scipy", "mujoco-core", "av"))


def test_what_make_installs_is_checked_against_them():
    assert "--require-hashes -r requirements.lock" in (ROOT / "Makefile").read_text()


def test_the_bill_of_materials_lists_the_same_packages():
    bill = json.loads((ROOT / "sbom.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    listed = [(part["name"], part["version"]) for part in bill["components"]]
    assert sorted(listed) == sorted((name, version) for name, version, *_ in PINS)
    assert "timestamp" not in bill["metadata"]
    assert "serialNumber" not in bill
