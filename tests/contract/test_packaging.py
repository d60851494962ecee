"""What is installed: packages with their data, the libraries they import, and pinned versions."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator

import pytest

from tests.contract.repository import PACKAGES, ROOT, own_files

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]
EXTRAS = PROJECT["optional-dependencies"]
# Import names that differ from the distribution's name.
MODULE_OF = {
    "colour-science": "colour",
    "pyserial": "serial",
    "pyusb": "usb",
    "tomli-w": "tomli_w",
    "warp-lang": "warp",
}
# xarray writes netCDF through h5netcdf, and that through h5py: no module of ours names them.
BACKENDS = {"h5netcdf", "h5py"}

# Parts of the product that need an extra, and its name: whoever imports them installs it.
PARTS_OF_EXTRAS = {
    ("scenarios", "explore"): "explore",
    ("scenarios", "strategies"): "test",
    ("hw_adapters", "wire", "usb650.py"): "instruments",
    ("hw_adapters", "wire", "protocol_benchtwin.py"): "instruments",
}

# Commands that open such a part, after it was checked that its extra is installed.
DOORS = {"scenarios/cli/explore.py"}


def names(requirements: list[str]) -> set[str]:
    """Distribution names of some requirements."""
    return {re.split(r"[\[<>=!~; ]", requirement)[0] for requirement in requirements}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def imported(source: str) -> Iterator[str]:
    """Top-level names of the modules that a source imports, anywhere in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.partition(".")[0]


def product_files(suffix: str | None = None) -> list:
    files = [path for path in own_files() if path.relative_to(ROOT).parts[0] in PACKAGES]
    return [path for path in files if suffix is None or path.suffix == suffix]


def modules_of(requirements: list[str]) -> set[str]:
    """Names by which some requirements are imported."""
    return {MODULE_OF.get(name, name).replace("-", "_") for name in names(requirements)}


def part_of(parts: tuple[str, ...]) -> str | None:
    """The extra that a file of the product may rely on, by the parts of its path."""
    found = [name for folder, name in PARTS_OF_EXTRAS.items() if parts[: len(folder)] == folder]
    return found[0] if found else None


def imported_by(extra: str | None) -> set[str]:
    """Libraries that the five packages import where they may rely on an extra, or on none."""
    found = {
        name
        for path in product_files(".py")
        if part_of(path.relative_to(ROOT).parts) == extra
        for name in imported(path.read_text(encoding="utf-8"))
    }
    return found - set(sys.stdlib_module_names) - set(PACKAGES)


def test_the_core_install_holds_every_library_that_is_imported():
    assert imported_by(None) - modules_of(PROJECT["dependencies"]) == set()


@pytest.mark.parametrize("extra", sorted(set(PARTS_OF_EXTRAS.values())))
def test_an_extra_holds_what_its_part_of_the_product_imports(extra: str):
    core = modules_of(PROJECT["dependencies"])
    assert imported_by(extra) - core - modules_of(EXTRAS[extra]) == set()
    assert imported_by(extra) - core != set()


def test_nothing_else_in_the_product_imports_a_part_of_an_extra():
    found = [
        str(path.relative_to(ROOT))
        for path in product_files(".py")
        if part_of(path.relative_to(ROOT).parts) is None
        for folder in PARTS_OF_EXTRAS
        if re.search(rf"^\s*(from|import) {'[.]'.join(folder)}\b", path.read_text(), re.MULTILINE)
    ]
    assert set(found) - DOORS == set()
    assert set(found) >= DOORS


def test_a_part_of_an_extra_is_that_folder_and_no_other():
    assert part_of(("scenarios", "strategies", "draws.py")) == "test"
    assert part_of(("scenarios", "pipeline.py")) is None
    assert part_of(("estimators", "strategies", "draws.py")) is None


def test_the_core_install_holds_nothing_else():
    assert modules_of(PROJECT["dependencies"]) - imported_by(None) - BACKENDS == set()


def test_the_search_for_imports_sees_inner_ones():
    source = "import a.b\n\ndef f():\n    from c.d import e\n    from . import g\n"
    assert set(imported(source)) == {"a", "c"}


def test_constraints_are_names_and_versions_only():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if line and not line.startswith("#")]
    assert pinned
    assert [line for line in pinned if not re.fullmatch(r"[\w.-]+==[\w.]+", line)] == []


def test_constraints_pin_every_dependency():
    extras = [requirement for extra in EXTRAS.values() for requirement in extra]
    asked = names(PROJECT["dependencies"] + extras) - {PROJECT["name"]}
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pinned = {line.partition("==")[0] for line in text.splitlines() if "==" in line}
    assert {canonical(name) for name in asked} <= {canonical(name) for name in pinned}


def test_the_extra_all_brings_every_other_extra():
    brought = re.fullmatch(r"benchtwin\[(.*)\]", EXTRAS["all"][0])[1].split(",")
    assert sorted(brought) == sorted(set(EXTRAS) - {"all"})


def test_every_package_is_found_and_typed():
    assert {path.parent.name for path in ROOT.glob("*/py.typed")} == set(PACKAGES)
    folders = {path.parent for path in product_files(".py")}
    assert [str(folder) for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_every_data_file_of_a_package_is_installed():
    patterns = SETTINGS["tool"]["setuptools"]["package-data"]["*"]
    endings = tuple(pattern.removeprefix("**/*") for pattern in patterns)
    data = [path for path in product_files() if path.suffix != ".py"]
    assert [str(path.relative_to(ROOT)) for path in data if not path.name.endswith(endings)] == []
