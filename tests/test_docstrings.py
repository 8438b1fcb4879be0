"""Docstrings that name shapes and errors, doctests that run, and an API page for each module."""

import ast
import doctest
import importlib
import inspect
import re

import jax
import jax.numpy as jnp
import pytest
from support.paths import REPOSITORY as ROOT
from test_architecture import ROOMS

from gril_jax import losses

PACKAGE = ROOT / "gril_jax"


def _listed():
    """The modules that the pages of the API show, without the name of the package."""
    pages = sorted((ROOT / "docs" / "api").glob("*.md"))
    return re.findall(
        r"^::: gril_jax\.(\S+)$", "\n".join(p.read_text() for p in pages), re.MULTILINE
    )


def _files(names):
    """The modules of these names, and those within the packages among them."""
    for name in names:
        place = PACKAGE / name.replace(".", "/")
        yield from sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]


def _module(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(["gril_jax", *(part for part in parts if part != "__init__")])


REFERENCE = [*dict.fromkeys(_files(_listed()))]


def _public(path):
    """(name, function) of a module's public functions, and of the methods of its classes."""
    tree = ast.parse(path.read_text())
    for node in tree.body:
        if not getattr(node, "name", "_").startswith("_"):
            if "losses" in path.parts and node.name not in losses.__all__:
                continue  # serves the others there
            yield node.name, node
            if isinstance(node, ast.ClassDef):
                for inner in node.body:
                    if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                        yield f"{node.name}.{inner.name}", inner


# "Arguments and errors are those of `step`": they stand there.
ELSEWHERE = re.compile(r"errors (are (those of|the same)|as for)")

# --- docstrings


def test_the_reference_has_a_page_for_every_pure_room():
    pure = {room for room, layer in ROOMS.items() if layer == "pure"}
    assert set(_listed()) >= pure
    assert len(set(_listed())) == len(_listed())


def test_the_reference_shows_each_public_module_of_a_package():
    for name in _listed():
        package = importlib.import_module(f"gril_jax.{name}")
        for public in getattr(package, "__all__", ()):
            value = getattr(package, public)
            if inspect.ismodule(value):
                assert value.__name__.removeprefix("gril_jax.") in _listed()


def test_a_module_says_what_it_is():
    for path in REFERENCE:
        assert importlib.import_module(_module(path)).__doc__, path


def test_everything_public_has_a_docstring_and_types():
    for name, node in [(f"{path}, {n}", node) for path in REFERENCE for n, node in _public(path)]:
        first = (ast.get_docstring(node) or "").split("\n\n")[0]
        assert first.endswith((".", ":")), f"{name}: its docstring's first paragraph is {first!r}"
        if isinstance(node, ast.FunctionDef):
            given = node.args.args + node.args.kwonlyargs + node.args.posonlyargs
            bare = [a.arg for a in given if a.annotation is None and a.arg not in ("self", "cls")]
            assert not bare, f"{name}: {bare} have no type"
            assert node.returns is not None or node.name == "main", f"{name} has no type of return"


def test_a_docstring_names_the_errors_that_its_function_raises():
    for path in REFERENCE:
        tree = ast.parse(path.read_text())
        functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        for name, node in _public(path):
            if isinstance(node, ast.FunctionDef):
                document = ast.get_docstring(node)
                raised = _raised(node, functions, set())
                missing = {error for error in raised if error not in document}
                if not ELSEWHERE.search(document):
                    assert not missing, f"{path}, {name} raises {missing}, but does not say so"


def _raised(function, functions, seen):
    """Our errors that a function raises itself, or in functions of its module that it calls."""
    found = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            error = ast.unparse(node.exc.func)
            found |= {error} if error in ("ConfigError", "ShapeError", "RewardFileError") else set()
        elif isinstance(node, ast.Call):
            callee = ast.unparse(node.func)
            if callee in functions and callee not in seen:
                seen.add(callee)
                found |= _raised(functions[callee], functions, seen)
    return found


# --- doctests


DOCTESTS = [path for path in sorted(PACKAGE.rglob("*.py")) if ">>> " in path.read_text()]


@pytest.mark.parametrize("path", DOCTESTS, ids=_module)
def test_the_doctests_of_a_module_pass(path):
    try:
        module = importlib.import_module(_module(path))
    except ModuleNotFoundError as error:
        pytest.skip(f"{error.name} is not installed")
    finder, runner = doctest.DocTestFinder(exclude_empty=True), doctest.DocTestRunner()
    names = {"jax": jax, "jnp": jnp}
    tests = [t for t in finder.find(module, extraglobs=names) if t.examples]
    examples = sum(len(test.examples) for test in tests)
    assert examples == path.read_text().count(">>> "), "a doctest stands where none is looked for"
    for test in tests:
        said = []
        failed, _ = runner.run(test, out=said.append)
        assert not failed, "".join(said)
