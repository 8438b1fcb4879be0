"""Who may import whom, read from the sources; see the table of layers below."""

import ast
import functools
import sys
from typing import NamedTuple

import pytest
from support.paths import REPOSITORY as ROOT

FOLDERS = {
    "gril_jax": "gril_jax",
    "envs": "gril_jax.envs",
    "configs": "gril_jax.configs",
    "experiments": "gril_jax.experiments",
}

# Each room of the house is of one layer; loose modules are rooms of their own.
ROOMS = {
    "errors": "ground", "lazy": "ground", "config": "options",
    "types": "pure", "graphs": "pure", "encoders": "pure", "losses": "pure",
    "reward": "pure", "metrics": "pure", "subtasks": "pure", "audit": "pure",
    "pretraining": "training", "rl": "training",
    "safe_files": "host", "threads": "host", "demos": "host", "runs": "host",
    "compilation": "host", "report": "host", "export": "host",
    "api": "runs", "cli": "runs", "workflows": "runs", "experiments": "runs",
    "envs": "tasks", "configs": "data",
}  # fmt: skip

# For each layer: the layers of ours that it may import, and the packages of others.
ARRAYS = {"jax", "jaxtyping"}
NETWORKS = ARRAYS | {"jraph", "flax.linen"}
ALGORITHMS = NETWORKS | {"optax", "flax.struct", "brax.training"}
LAYERS = {
    "data": (set(), set()),
    "tasks": ({"tasks"}, ARRAYS | {"numpy", "mujoco", "flax.struct"}),
    "ground": (set(), set()),
    "options": ({"ground", "options"}, {"tyro", "yaml"}),
    "pure": ({"ground", "options", "pure"}, NETWORKS),
    "training": ({"ground", "options", "pure", "training"}, ALGORITHMS),
    "host": (
        {"ground", "options", "pure", "training", "host"},
        ALGORITHMS
        | {"numpy", "scipy", "tyro", "yaml", "rich", "orbax", "absl"}
        | {"mujoco", "matplotlib", "av", "cv2"},
    ),
    "runs": (
        {"ground", "options", "pure", "training", "host", "tasks", "runs"},
        None,
    ),  # None: any package
}

# Files and clocks are for the host.
NOT_PURE = {"io", "os", "pathlib", "shutil", "subprocess", "tempfile", "time", "random"}
# An import inside a function is for the command line, and for optional extras: (file, package).
LATE_EXTRAS = {
    ("gril_jax/losses/soft_dtw.py", "gril_jax.losses.gpu_kernel"),
    ("gril_jax/reward/learned_reward.py", "gril_jax.export.reward_file"),  # its method `save`
}
# The table of tasks is names and import paths alone: the schema checks names against it.
LIGHT = {("gril_jax/config/task.py", "gril_jax.envs.registry")}
KERNEL = ROOT / "envs/planar/kernel"
# What only an adapter to it, or a kernel in it, imports: (file, package).
ADAPTED = {("gril_jax/export/gymnasium.py", "gymnasium"), ("gril_jax/export/gymnax.py", "gymnax")}
ADAPTED |= {(path.relative_to(ROOT).as_posix(), "warp") for path in KERNEL.glob("*.py")}
# The only reader of pickles, with an unpickler that builds nothing but arrays.
PICKLES = {"gril_jax/demos/magical_pickles.py"}

# What a person starts, and so may answer on stdout.
COMMANDS = {
    "gril_jax/cli/main.py", "gril_jax/cli/arguments.py",
    "experiments/fidelity/physics_parity.py", "experiments/examples/my_task/make_films.py",
}  # fmt: skip


class Import(NamedTuple):
    """One imported name, as far as it is a module of ours or of others."""

    module: str
    inside_function: bool


FILES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))


def _relative(path):
    return path.relative_to(ROOT).as_posix()


def _module(path):
    """gril_jax.envs.base for envs/base.py; a package's name for its __init__.py."""
    folder, *parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join([FOLDERS[folder], *(part for part in parts if part != "__init__")])


MODULES = {_module(path): path for path in FILES}


def _imports(tree, module, is_package):
    """Every import of a source, absolute; `from package import module` gives the module."""
    late = {
        node
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node in late)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                above = parts[: len(parts) - node.level + is_package]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                name = f"{base}.{alias.name}"
                ours = base.split(".")[0] == "gril_jax"
                yield Import(name if name in MODULES or not ours else base, node in late)


@functools.cache
def _tree(path):
    return ast.parse(path.read_text())


@functools.cache
def _imports_of(path):
    return list(_imports(_tree(path), _module(path), path.name == "__init__.py"))


def _room(module):
    """reward for gril_jax.reward.shaping; the whole package's __init__ is a room without walls."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def _layer(module):
    return ROOMS[_room(module)] if _room(module) else "data"


def _allowed(name, packages):
    return any(name == p or name.startswith(f"{p}.") for p in packages)


def _faults(path):
    """Imports of a file that its layer must not have."""
    module = _module(path)
    layer = _layer(module)
    layers, packages = LAYERS[layer]
    for name, _ in _imports_of(path):
        top = name.split(".")[0]
        if top == "gril_jax":
            # a package's __init__ lists its own modules, whatever layer they are
            known = (_relative(path), name) in LIGHT | LATE_EXTRAS
            own = name.startswith(f"{module}.") or known
            if _layer(name) not in layers and not own:
                yield f"{layer} layer imports {name} of the {_layer(name)} layer"
        elif top in sys.stdlib_module_names:
            if layer == "pure" and top in NOT_PURE:
                yield f"pure layer imports {name}"
        elif packages is not None and not _allowed(name, packages):
            if (_relative(path), top) in ADAPTED:
                continue
            yield f"{layer} layer imports {name}"


def test_a_module_imports_only_what_its_layer_may():
    assert {_relative(path): found for path in FILES if (found := [*_faults(path)])} == {}


def test_imports_stand_at_the_top_except_in_the_command_line():
    late = {(_relative(path), i.module) for path in FILES for i in _imports_of(path)
            if i.inside_function}  # fmt: skip
    assert {one for one in late if not one[0].startswith("gril_jax/cli/")} <= LATE_EXTRAS


def test_workflows_are_imported_by_the_command_line_and_the_front_door_alone():
    for path in FILES:
        where = _relative(path)
        for name, inside_function in _imports_of(path):
            if not name.startswith(("gril_jax.workflows", "gril_jax.experiments")):
                continue
            if where.startswith("gril_jax/cli/"):
                assert inside_function, f"{where} imports {name} before it is needed"
            else:
                assert where.startswith(("gril_jax/workflows/", "gril_jax/api/", "experiments/")), (
                    where
                )


def test_the_words_of_a_command_line_are_read_by_the_command_line_alone():
    notes = "gril_jax/runs/reading.py"  # how the process was started
    readers = {
        _relative(path)
        for path in FILES
        if _relative(path).startswith(("gril_jax/", "envs/")) and "argv" in _names(path)
    }
    assert {one for one in readers if not one.startswith("gril_jax/cli/")} == {notes}
    parsers = {_relative(path) for path in FILES if "tyro" in _names(path)}
    assert "gril_jax/config/command_line.py" in parsers
    for path in parsers:
        if path.startswith(("gril_jax/", "envs/")):
            assert path.startswith(("gril_jax/cli/", "gril_jax/config/")), path


def _names(path):
    """The attributes and names in a source."""
    nodes = ast.walk(_tree(path))
    return {getattr(node, "attr", getattr(node, "id", None)) for node in nodes}


def test_there_are_no_import_cycles():
    graph = {
        module: {
            i.module
            for i in _imports_of(path)
            if i.module in MODULES and (_relative(path), i.module) not in LATE_EXTRAS
        }
        - {module}
        for module, path in MODULES.items()
    }
    done: set[str] = set()

    def visit(module, trail):
        assert module not in trail, " -> ".join([*trail, module])
        if module not in done:
            for name in sorted(graph[module]):
                visit(name, [*trail, module])
            done.add(module)

    for module in graph:
        visit(module, [])


def test_there_are_no_cycles_of_rooms():
    """A room's `__init__` imports all of it, so that a cycle of rooms is one of modules."""
    graph: dict[str, set[str]] = {}
    for module, path in MODULES.items():
        for name, late in _imports_of(path):
            if name in MODULES and not late and _room(name) != _room(module):
                graph.setdefault(_room(module), set()).add(_room(name))
    order = []
    while ready := [room for room in graph if graph[room] <= {*order} | ({*ROOMS} - {*graph})]:
        order += ready
        for room in ready:
            del graph[room]
    assert graph == {}


# --- a room for everything


def _folders():
    for name in (*FOLDERS, "tests"):
        yield from {path.parent for path in (ROOT / name).rglob("*.py")}


def test_modules_do_not_lie_loose():
    assert len(list((ROOT / "gril_jax").glob("*.py"))) <= 6
    loose = {path.stem for path in (ROOT / "envs").glob("*.py")}
    assert loose <= {"__init__", "base", "registry", "stages", "checks"}


def test_no_prefix_stands_in_for_a_folder():
    for folder in {*_folders()}:
        prefixes = [p.stem.removeprefix("test_").split("_")[0] for p in folder.glob("[!_]*.py")]
        assert [prefix for prefix in {*prefixes} if prefixes.count(prefix) > 3] == [], folder


def test_the_package_itself_imports_nothing():
    assert {i.module for i in _imports_of(ROOT / "gril_jax" / "__init__.py")} == {"gril_jax.lazy"}
    found = {i.module.split(".")[0] for i in _imports_of(ROOT / "gril_jax" / "lazy.py")}
    assert found <= sys.stdlib_module_names


# --- what no module does


def _calls(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def test_no_module_runs_code_from_a_file_or_prints_to_stdout():
    for path in FILES:
        for name, node in _calls(_tree(path)):
            where = f"{_relative(path)}: {ast.unparse(node)}"
            assert name not in ("eval", "exec", "yaml.load", "yaml.unsafe_load"), where
            keywords = {k.arg: ast.unparse(k.value) for k in node.keywords}
            assert keywords.get("allow_pickle") != "True", where
            if name == "print" and _relative(path) not in COMMANDS:
                assert "file" in keywords, where
        readers = {i.module.split(".")[0] for i in _imports_of(path)} & {"pickle", "dill", "joblib"}
        assert not readers or _relative(path) in PICKLES, path


def test_no_module_changes_the_process_when_it_is_imported():
    for path in FILES:
        for statement in _tree(path).body:
            if isinstance(statement, ast.FunctionDef | ast.ClassDef):
                continue
            for node in ast.walk(statement):
                if isinstance(node, ast.Assign | ast.AugAssign | ast.Call):
                    text = ast.unparse(node)
                    assert not text.startswith(("os.environ", "jax.config.")), (path, text)


# --- the reader of imports is right


@pytest.mark.parametrize(
    ("source", "module", "is_package", "found"),
    [
        ("import jax.numpy as jnp", "gril_jax.reward", False, "jax.numpy"),
        ("from flax import linen", "gril_jax.encoders.encoder", False, "flax.linen"),
        ("from . import config", "gril_jax.cli", False, "gril_jax.config"),
        ("from .loop import restore", "gril_jax.runs.run_dir", False, "gril_jax.runs.loop"),
        ("from ..errors import RunError", "gril_jax.rl.ppo", False, "gril_jax.errors"),
        ("from .base import State", "gril_jax.envs", True, "gril_jax.envs.base"),
        ("from gril_jax import envs", "gril_jax.demos", False, "gril_jax.envs"),
        ("from gril_jax.envs import make", "gril_jax.demos", False, "gril_jax.envs"),
    ],
)
def test_imports_are_resolved(source, module, is_package, found):
    assert list(_imports(ast.parse(source), module, is_package)) == [Import(found, False)]
    inside = ast.parse(f"def f():\n    {source}\n")
    assert list(_imports(inside, module, is_package)) == [Import(found, True)]


@pytest.mark.parametrize(
    ("name", "line", "fault"),
    [
        ("gril_jax/reward/latent_goal.py", "import numpy", "pure layer imports numpy"),
        ("gril_jax/reward/latent_goal.py", "import os", "pure layer imports os"),
        ("gril_jax/reward/latent_goal.py", "from ..runs import run_dir", "of the host layer"),
        ("gril_jax/demos/demo_set.py", "from ..envs import make", "of the tasks layer"),
        ("gril_jax/rl/ppo.py", "import orbax.checkpoint", "training layer imports orbax"),
        ("gril_jax/demos/demo_set.py", "from .. import cli", "of the runs layer"),
        ("envs/base.py", "from gril_jax.types import Nodes", "of the pure layer"),
        ("envs/base.py", "import optax", "tasks layer imports optax"),
    ],
)
def test_a_fault_would_be_found(tmp_path, monkeypatch, name, line, fault):
    path = tmp_path / name
    path.parent.mkdir(parents=True)
    path.write_text(line)
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    (found,) = _faults(path)
    assert fault in found
