"""What the contract tests know of the repository: its files, packages and modules."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("twin", "estimators", "hw_adapters", "scenarios", "diagnosis")


def own_files() -> list[Path]:
    """Every file of ours, tracked or new, but nothing that git ignores."""
    listed = listed_by_git()
    return walked() if listed is None else listed


def listed_by_git() -> list[Path] | None:
    """What git lists, or None without git or outside a clone."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    names = [name for name in listed.stdout.decode().split("\0") if name]
    return sorted({ROOT / name for name in names if (ROOT / name).is_file()})


def walked() -> list[Path]:
    """What a walk finds, without environments, builds and caches."""
    found = []
    for folder, names, files in os.walk(ROOT):
        names[:] = [
            name
            for name in names
            if (name == ".ci" or not name.startswith("."))
            and name not in {"build", "dist", "__pycache__", "_build"}
            and not name.endswith(".egg-info")
            and not name.startswith("benchtwin-")
        ]
        found += [Path(folder) / name for name in files]
    return sorted(found)


def text_of(path: Path) -> str | None:
    """The text of a file, or None when it is not text."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None


def python_files() -> list[Path]:
    """Every Python file of ours."""
    return [path for path in own_files() if path.suffix == ".py"]


def run_python(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run this interpreter with arguments; the result carries exit code and both outputs."""
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, check=False
    )
