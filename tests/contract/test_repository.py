"""What the files of the repository must and must not hold."""

from __future__ import annotations

import re
import warnings

import pytest

from tests.contract.repository import (
    ROOT,
    listed_by_git,
    own_files,
    python_files,
    text_of,
    walked,
)

# Put together here, so that this file does not hold what it looks for.
HOSTS = re.compile(
    "|".join(
        r"\.".join(parts)
        for parts in (
            ("pypi", "org"),
            ("pythonhosted", "org"),
            ("deb", "debian", "org"),
            ("npmjs", "(org|com)"),
            ("anaconda", "org"),
            ("crates", "io"),
        )
    ),
    re.IGNORECASE,
)
MACHINE_PATHS = re.compile(r"(?<![\w.])/(" + "|".join(("work", "root", "home", "Users")) + ")/")
UNFINISHED = re.compile(r"\b(" + "|".join(("TO" + "DO", "FIX" + "ME", "X" * 3)) + r")\b")
LONGEST_MODULE = 600
LONG_MODULE = 300
LARGEST_FILE = 1_000_000
SHELL_BLOCK = re.compile(r"^```(?:sh|bash|shell|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?://|#|mailto:)([^)\s#]+)")


def offences(pattern: re.Pattern[str], text: str) -> list[str]:
    """Lines of a text that hold a pattern, with their numbers."""
    return [f"{i}: {line}" for i, line in enumerate(text.split("\n"), 1) if pattern.search(line)]


def offending_files(pattern: re.Pattern[str], files: list) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{line}"
        for path in files
        for line in offences(pattern, text_of(path) or "")
    ]


def commands() -> list[str]:
    """The README's shell blocks."""
    return SHELL_BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))


def test_without_git_the_same_modules_are_looked_at():
    listed = listed_by_git()
    if listed is None:
        pytest.skip("no git, or not a clone: there is nothing to compare the walk with")
    assert {p for p in listed if p.suffix == ".py"} == {p for p in walked() if p.suffix == ".py"}


def test_no_file_names_a_package_registry():
    assert offending_files(HOSTS, own_files()) == []


def test_no_file_holds_a_path_of_a_machine():
    assert offending_files(MACHINE_PATHS, own_files()) == []


def test_no_code_is_left_unfinished():
    assert offending_files(UNFINISHED, python_files()) == []


@pytest.mark.parametrize(
    ("pattern", "planted", "harmless"),
    [
        (HOSTS, "https://files.python" + "hosted.org/x", "https://doi.org/10.1364/AO.1"),
        (MACHINE_PATHS, "open('/ho" + "me/me/x')", "./home/x and a/work/b"),
        (UNFINISHED, "# TO" + "DO later", "todo"),
    ],
)
def test_the_search_can_fail(pattern: re.Pattern[str], planted: str, harmless: str):
    assert offences(pattern, f"fine\n{planted}\n") == [f"2: {planted}"]
    assert offences(pattern, harmless) == []


def test_modules_are_short():
    lengths = {
        str(path.relative_to(ROOT)): len((text_of(path) or "").splitlines())
        for path in python_files()
    }
    long = {name: length for name, length in lengths.items() if length > LONG_MODULE}
    if long:
        listed = ", ".join(f"{name} ({length})" for name, length in sorted(long.items()))
        warnings.warn(f"modules longer than {LONG_MODULE} lines: {listed}", stacklevel=1)
    assert {name for name, length in long.items() if length > LONGEST_MODULE} == set()


def test_no_file_is_large():
    sizes = {path.name: path.stat().st_size for path in own_files()}
    assert {name: size for name, size in sizes.items() if size > LARGEST_FILE} == {}


def test_the_readme_has_exactly_two_commands_of_one_line():
    assert len(commands()) == 2
    assert [command.count("\n") for command in commands()] == [1, 1]
    assert "benchtwin run" in commands()[0]
    assert "pytest" in commands()[1]


def test_ci_runs_the_second_command_of_the_readme():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert [line for line in script if "venv" in line] == [commands()[1].strip()]
    assert "set -euo pipefail" in script


def test_links_between_documents_lead_somewhere():
    broken = [
        f"{path.relative_to(ROOT)}: {target}"
        for path in own_files()
        if path.suffix == ".md"
        for target in LINK.findall(path.read_text(encoding="utf-8"))
        if not (path.parent / target).exists()
    ]
    assert broken == []
