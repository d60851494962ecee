"""Lint, format, types and layers, each with a control that must fail."""

from __future__ import annotations

import tomllib
import warnings
from pathlib import Path

import pytest

from tests.contract.repository import PACKAGES, ROOT, python_files, run_python

LINT_IMPORTS = (
    "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"
)


def ruff(*arguments: str) -> tuple[int, str]:
    done = run_python("-m", "ruff", *arguments)
    return done.returncode, done.stdout + done.stderr


def mypy(*arguments: str) -> tuple[int, str]:
    done = run_python("-m", "mypy", "--no-error-summary", *arguments)
    return done.returncode, done.stdout + done.stderr


def lint_imports(folder: Path) -> tuple[int, str]:
    done = run_python("-c", LINT_IMPORTS, cwd=folder)
    return done.returncode, done.stdout + done.stderr


def test_ruff_finds_nothing():
    code, output = ruff("check", "--quiet", "--output-format", "concise", ".")
    assert code == 0, output


def test_everything_is_formatted():
    code, output = ruff("format", "--check", "--quiet", "--output-format", "concise", ".")
    assert code == 0, output


@pytest.mark.parametrize(
    ("source", "rule"),
    [
        ("import pickle\n\nprint(pickle)\n", "TID251"),
        ('"""Doc."""\n\n\ndef shown() -> None:\n    return\n', "D103"),
        ('"""Doc."""\n\ntry:\n    x = 1\nexcept Exception:\n    x = 2\n', "BLE001"),
        ('"""Doc."""\n\nimport numpy as np\n\nx = np.random.default_rng(1)\n', "TID251"),
    ],
)
def test_ruff_can_fail(tmp_path: Path, source: str, rule: str):
    path = tmp_path / "planted.py"
    path.write_text(source, encoding="utf-8")
    code, output = ruff("check", "--config", str(ROOT / "pyproject.toml"), str(path))
    assert code == 1
    assert rule in output


def test_mypy_finds_nothing():
    code, output = mypy()
    assert code == 0, output


def test_mypy_can_fail(tmp_path: Path):
    path = tmp_path / "planted.py"
    path.write_text("def half(value: float):\n    return value / 2\n", encoding="utf-8")
    code, output = mypy("--config-file", str(ROOT / "pyproject.toml"), str(path))
    assert code == 1
    assert "no-untyped-def" in output


def test_only_kernels_are_outside_the_type_check():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    unchecked = {
        module
        for override in settings["tool"]["mypy"]["overrides"]
        if override.get("ignore_errors")
        for module in override["module"]
    }
    kernels = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in python_files()
        if path.stem.endswith("kernels") and path.relative_to(ROOT).parts[0] in PACKAGES
    }
    assert unchecked == kernels


def test_layers_hold():
    code, output = lint_imports(ROOT)
    assert code == 0, output


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("twin", "estimators"),
        ("estimators", "hw_adapters"),
        ("hw_adapters", "estimators"),
        ("diagnosis", "scenarios"),
        ("twin", "mitsuba"),
        ("scenarios", "hypothesis"),
    ],
)
def test_layers_can_fail(tmp_path: Path, importer: str, imported: str):
    (tmp_path / "pyproject.toml").write_bytes((ROOT / "pyproject.toml").read_bytes())
    for package in PACKAGES:
        (tmp_path / package).mkdir()
        source = f"import {imported}\n" if package == importer else ""
        (tmp_path / package / "__init__.py").write_text(source, encoding="utf-8")
    code, output = lint_imports(tmp_path)
    assert code == 1
    assert f"{importer} -> {imported}" in output


@pytest.mark.parametrize("category", [RuntimeWarning, DeprecationWarning])
def test_a_warning_from_our_packages_is_an_error(category: type[Warning]):
    with pytest.raises(category):
        warnings.warn_explicit("planted", category, "planted.py", 1, module="twin.planted")
    with pytest.warns(category):
        warnings.warn_explicit("planted", category, "planted.py", 1, module="others.planted")
