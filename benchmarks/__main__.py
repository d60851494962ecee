"""`python -m benchmarks NAME [--json] [--quick]`: run one benchmark and print what it measured.

A benchmark is a module of this folder with a function `run(quick: bool) -> dict[str, object]`
whose keys and values are the figures. Progress goes to standard error; standard output carries
a table for people, or with `--json` exactly one JSON object.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import importlib.metadata
import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# As the command line does (scenarios/cli/guard.py), before numpy reads it: threads that wait for
# each other on small matrices take four times as long, and processor time counts them all.

import numpy as np

from scenarios.console import output_to_error
from twin.errors import InputError

FOLDER = Path(__file__).parent
VERSIONS_OF = ("benchtwin", "numpy", "scipy", "warp-lang", "jax", "mitsuba", "iadpython")
OWN_PACKAGES = ("twin", "estimators", "hw_adapters", "scenarios", "diagnosis", "benchmarks")
EXIT_INPUT = 2
EXIT_UNAVAILABLE = 3


def discover(folder: Path = FOLDER) -> dict[str, str]:
    """Benchmarks of a folder by name, with the first line of each docstring.

    Modules are read, not imported: listing costs nothing and needs no peer installed.
    """
    found: dict[str, str] = {}
    for path in sorted(folder.glob("*.py")):
        if path.stem.startswith("_"):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
        if any(isinstance(node, ast.FunctionDef) and node.name == "run" for node in tree.body):
            found[path.stem] = (ast.get_docstring(tree) or "").partition("\n")[0]
    return found


def machine() -> dict[str, object]:
    """Facts about this machine that a figure depends on."""
    versions: dict[str, str] = {}
    for name in VERSIONS_OF:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    usable = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    return {
        "cores": len(usable) if usable else os.cpu_count(),
        "processor": _processor(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": versions,
    }


def _processor() -> str:
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def plain(value: object) -> object:
    """The same value in the types of JSON; numbers that are not finite become null.

    Raises:
        TypeError: the value has no counterpart in JSON.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    raise TypeError(f"a benchmark returned a {type(value).__name__}, which JSON cannot hold")


def table(values: Mapping[str, object], indent: str = "") -> str:
    """The figures as lines of text, nested ones indented."""
    width = max((len(key) for key in values), default=0)
    lines = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{key}", table(value, indent + "  ")]
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            lines += [f"{indent}{key}", *(f"{indent}  {_row(item)}" for item in value)]
        else:
            lines.append(f"{indent}{key:<{width}}  {_text(value)}")
    return "\n".join(lines)


def _row(item: Mapping[str, object]) -> str:
    return "  ".join(f"{key} {_text(value)}" for key, value in item.items())


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return " ".join(_text(item) for item in value)
    return "-" if value is None else str(value)


def run(name: str, *, quick: bool) -> dict[str, object]:
    """Run one benchmark: its figures, and under `machine` where they were measured."""
    with output_to_error():
        figures = importlib.import_module(f"benchmarks.{name}").run(quick)
    report = {"benchmark": name, "quick": quick, **figures, "machine": machine()}
    return {key: plain(value) for key, value in report.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command: returns its exit code.

    0: measured; 2: a name or an input that cannot be used; 3: a library is not installed.
    """
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Run one benchmark and print what it measured.",
        epilog="example: python -m benchmarks lut --json",
    )
    parser.add_argument("name", nargs="?", help="the benchmark; --list shows which there are")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="a short run, for trying it out")
    parser.add_argument("--list", action="store_true", help="list the benchmarks and stop")
    options = parser.parse_args(arguments)
    known = discover()
    if options.list:
        print("\n".join(f"{name:<14} {text}" for name, text in known.items()))
        return 0
    if options.name not in known:
        found = "no benchmark's name" if options.name is None else f"benchmark {options.name!r}"
        names = ", ".join(known) or "(none yet)"
        print(f"found {found}; expected one of: {names}", file=sys.stderr)
        return EXIT_INPUT
    try:
        report = run(options.name, quick=options.quick)
    except InputError as error:
        print(error, file=sys.stderr)
        return EXIT_INPUT
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] in OWN_PACKAGES:
            raise
        print(
            f"found no module {error.name!r}; expected what {options.name!r} compares with."
            " Install the extra `all`.",
            file=sys.stderr,
        )
        return EXIT_UNAVAILABLE
    print(json.dumps(report, allow_nan=False) if options.json else table(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
