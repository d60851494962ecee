"""What the packages show: every name resolves, is documented, and costs little to import."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from tests.contract.repository import PACKAGES, run_python

HEAVY = ("warp", "jax", "colour", "matplotlib")
SHAPE = re.compile(r"\((?:[A-Za-z0-9][\w +*-]*,\s*)*[A-Za-z0-9][\w +*-]*,?\s*\)|shape|scalar")
WHAT_WAS_LOADED = """
import contextlib, io, json, sys
code, shown = 0, io.StringIO()
with contextlib.redirect_stdout(shown):
    try:
        {statement}
    except SystemExit as stop:
        code = stop.code or 0
print(json.dumps({{"code": code, "shown": shown.getvalue(), "loaded": sorted(sys.modules)}}))
"""


class Public(NamedTuple):
    """A public function, class or method and the name by which a person finds it."""

    name: str
    item: object


def exporting_packages() -> list[str]:
    """The five packages and every package inside them."""
    names = list(PACKAGES)
    for package in PACKAGES:
        path = importlib.import_module(package).__path__
        names += [m.name for m in pkgutil.walk_packages(path, f"{package}.") if m.ispkg]
    return names


def public() -> Iterator[Public]:
    """Every function and class that a package exports, and the public methods of those classes."""
    for package in exporting_packages():
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", ()):
            item = getattr(module, name)
            if not (inspect.isfunction(item) or inspect.isclass(item)):
                continue
            yield Public(f"{package}.{name}", item)
            if inspect.isclass(item):
                for method, value in vars(item).items():
                    if inspect.isfunction(value) and not method.startswith("_"):
                        yield Public(f"{package}.{name}.{method}", value)


def complaints(item: object) -> list[str]:
    """What the docstring of a public function, method or class lacks."""
    text = inspect.getdoc(item) or ""
    if not text:
        return ["has no docstring"]
    if not inspect.isfunction(item):
        return []
    found = []
    if raises(item) and "Raises:" not in text:
        found.append("raises, and its docstring has no `Raises:`")
    annotations = " ".join(str(value) for value in item.__annotations__.values())
    if re.search(r"FloatArray|NDArray|ndarray", annotations) and not SHAPE.search(text):
        found.append("takes or returns an array, and its docstring tells no shape")
    return found


def raises(function: object) -> bool:
    """Whether the body of a function raises an error that it makes itself."""
    try:
        source = inspect.getsource(function)
    except OSError:  # `hypothesis.strategies.composite` makes functions that no file holds
        return False
    tree = ast.parse(textwrap.dedent(source))
    return any(isinstance(node, ast.Raise) and node.exc is not None for node in ast.walk(tree))


def loaded_by(statement: str) -> dict:
    """Exit code, output and loaded modules after a statement in a new interpreter."""
    done = run_python("-c", WHAT_WAS_LOADED.format(statement=statement))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("package", exporting_packages())
def test_public_names_resolve(package: str):
    module = importlib.import_module(package)
    names = getattr(module, "__all__", None)
    assert names is not None, f"{package} does not say what it exports"
    assert len(set(names)) == len(names)
    assert [name for name in names if not hasattr(module, name)] == []
    assert (module.__doc__ or "").strip()


def test_public_docstrings_tell_shapes_and_errors():
    found = [f"{name} {what}" for name, item in public() for what in complaints(item)]
    assert found == []


def test_the_docstring_check_can_fail():
    def undocumented(value: float) -> float:
        return value

    def unshaped(value: np.ndarray) -> float:  # noqa: F821
        """Return the mean."""
        raise ValueError("found nothing")

    assert complaints(undocumented) == ["has no docstring"]
    assert len(complaints(unshaped)) == 2


def test_packages_import_without_heavy_libraries():
    loaded = loaded_by(f"import {', '.join(PACKAGES)}")["loaded"]
    assert sorted(set(HEAVY) & set(loaded)) == []
    assert set(PACKAGES) <= set(loaded)


def test_help_imports_no_heavy_library():
    statement = "sys.argv = ['benchtwin', '--help']; from scenarios.cli import main; main()"
    result = loaded_by(statement)
    assert result["code"] == 0
    assert "estimate" in result["shown"]
    assert sorted(set(HEAVY) & set(result["loaded"])) == []


def test_the_import_check_can_fail():
    assert "matplotlib" in loaded_by("import matplotlib")["loaded"]
