"""Follow a page: write its files, run its commands and its Python, compare what it shows."""

from __future__ import annotations

import linecache
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from typer.main import get_command
from typer.testing import CliRunner

from scenarios.cli import app
from tests.docs.pages import ROOT, Block, Command, commands_of, file_of

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
SHARE = 0.1
"""A shown number with a decimal point may be wrong by this share, or by two of its last digit."""


class Follower:
    """One reader of one page, in a folder of his own that holds `docs/examples` as a checkout does.

    Attributes:
        folder: the working directory; the caller has entered it.
        names: what the Python of the page has defined so far.
        missing: reference data that blocks need and that are not on this machine.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: dict[str, Any] = {"__name__": "__main__"}
        self.missing: list[str] = []
        shutil.copytree(ROOT / "docs" / "examples", folder / "docs" / "examples")

    def follow(self, blocks: Iterable[Block]) -> int:
        """Run what is to be run.

        Returns:
            Number of blocks that ran.
        """
        return sum(self._one(block) for block in blocks)

    def _one(self, block: Block) -> bool:
        if block.kind == "file":
            return self._write(block)
        if not block.is_run:
            parse_only(block)
            return False
        if not self._brought(block):
            return False
        for command in block.marked("first"):
            run(Command(command), block)
        if block.kind == "python":
            self._python(block)
        else:
            self._commands(block)
        return True

    def _write(self, block: Block) -> bool:
        named = file_of(block)
        if named is None:
            return False
        name, text = named
        path = self.folder / name.removeprefix("add to ")
        path.parent.mkdir(parents=True, exist_ok=True)
        before = path.read_text(encoding="utf-8") if name.startswith("add to ") else ""
        path.write_text(text + before, encoding="utf-8")
        return True

    def _brought(self, block: Block) -> bool:
        """Copy the reference data that a block needs; False where they are not here."""
        for name in block.marked("needs"):
            source = ROOT.parent / "shared" / "data" / name
            if not source.is_file():
                self.missing.append(f"{block.place} needs {name}")
                return False
            shutil.copy(source, self.folder)
        return True

    def _commands(self, block: Block) -> None:
        shown = commands_of(block)
        shorter = block.instead
        if not shorter:
            for command in shown:
                run(command, block)
            return
        assert len(shorter) == len(shown), f"{block.place}: a marker for every command"
        for command, instead in zip(shown, shorter, strict=True):
            parse_benchtwin(command.words)
            if not instead:
                continue
            same = " ".join(instead.split()[:2])
            assert same in command.text, f"{block.place}: {instead} is another command"
            run(Command(instead, command.shown), block, numbers=False)

    def _python(self, block: Block) -> None:
        """Run a block as pytest would: functions that are called test_... are called."""
        before = set(self.names)
        linecache.cache[block.place] = (
            len(block.text), None, block.text.splitlines(keepends=True), block.place,
        )  # fmt: skip
        exec(compile(block.text, block.place, "exec"), self.names)  # noqa: S102 - our own page
        for name in sorted(set(self.names) - before):
            if name.startswith("test_"):
                self.names[name]()


def run(command: Command, block: Block, *, numbers: bool = True) -> None:
    """Run a command. It fails where the page shows its message, and only there."""
    words = command.words
    if words[0] == "benchtwin":
        result = CliRunner().invoke(app, words[1:])
        code, said = result.exit_code, result.stdout + result.stderr
    elif words[0] == "python":
        done = subprocess.run(
            [sys.executable, *words[1:]], capture_output=True, text=True, check=False
        )
        code, said = done.returncode, done.stdout + done.stderr
    else:
        raise AssertionError(f"{block.place}: how to run {words[0]}? Mark it as `not run`")
    fails = any(line.startswith("benchtwin: ") for line in command.shown)
    assert code == (2 if fails else 0), f"{block.place}: {command.text}: exit code {code}\n{said}"
    for line in command.shown:
        assert is_said(line, said, numbers=numbers), (
            f"{block.place}: {command.text}\nnot said: {line}\n{said}"
        )


def is_said(line: str, said: str, *, numbers: bool = True) -> bool:
    """Whether a line that a page shows is in what a command said.

    Blanks and line ends count as one blank, `...` stands for anything. Whole numbers must be
    equal, others within `SHARE` or two of the last shown digit; with `numbers=False` any number
    will do.
    """
    shown, said = " ".join(line.split()), " ".join(said.split())
    printed = {match[0] for match in NUMBER.finditer(said)}
    pattern, last = "", 0
    for number in NUMBER.finditer(shown):
        alike = [one for one in printed if not numbers or _close(number[0], one)]
        pattern += _literally(shown[last : number.start()])
        pattern += rf"(?<![\w.])(?:{'|'.join(map(re.escape, alike)) or '(?!)'})(?![\w.]*\w)"
        last = number.end()
    return re.search(pattern + _literally(shown[last:]), said) is not None


def _literally(text: str) -> str:
    return ".*?".join(re.escape(part) for part in re.split(r"\s?\.\.\.\s?", text))


def _close(shown: str, said: str) -> bool:
    if "." not in shown and "e" not in shown:
        return float(shown) == float(said)
    mantissa, _, exponent = shown.partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(float(shown) - float(said)) <= max(SHARE * abs(float(shown)), 2.001 * digit)


def parse_only(block: Block) -> None:
    """Of commands that are not run, at least the options and names exist."""
    if block.kind == "python":
        compile(block.text, block.place, "exec")
        return
    for command in commands_of(block):
        parse_benchtwin(command.words)


def parse_benchtwin(words: list[str]) -> None:
    """Read the arguments of a command without running it; others are left alone."""
    if words[0] != "benchtwin":
        return
    command: Any = get_command(app)
    rest = words[1:]
    while hasattr(command, "commands"):
        assert set(rest[:1]) & set(command.commands), f"no command {' '.join(words)}"
        command = command.commands[rest.pop(0)]
    command.make_context(" ".join(words[:2]), rest)
