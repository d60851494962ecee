"""What a page holds to run: its blocks, with the comments above them that say how.

`python -m tests.docs.pages` lists the blocks that are not run as they stand, with the reason.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MARKER = re.compile(r"<!--\s*(not run|run as|run by|first|needs):\s*(.*?)\s*-->", re.DOTALL)
ANYTHING = re.compile(r"<!--\s*(\w+( \w+)?):.*?-->", re.DOTALL)
FENCE = re.compile(r"^```(.*)$")
INDENTED = re.compile(r"^    (benchtwin|python|pip) ")
KINDS = {"python": "python", "console": "console", "toml": "file", "text": "file"} | dict.fromkeys(
    ("sh", "bash", "shell"), "shell"
)
NAME_OF_FILE = re.compile(r"^# ((?:add to )?[\w./-]+\.(?:toml|csv))$")


@dataclass(frozen=True)
class Block:
    """A part of a page that a reader would run, or a file that he would write.

    Attributes:
        page: path from the root of the repository.
        line: of the first line of the text.
        kind: "python", "shell" (commands), "console" (commands and what they say) or "file".
        text: what stands in the block.
        markers: (name, value) of the comments above it, in order.
    """

    page: str
    line: int
    kind: str
    text: str
    markers: tuple[tuple[str, str], ...] = ()

    def marked(self, name: str) -> list[str]:
        """Values of the markers of one name."""
        return [" ".join(value.split()) for key, value in self.markers if key == name]

    @property
    def is_run(self) -> bool:
        """Whether this block is run here, in this form or in a shorter one."""
        left_out = self.marked("not run") and not self.marked("run as")
        return not left_out and not self.marked("run by")

    @property
    def instead(self) -> list[str]:
        """What is run in the place of every command; "" where one is not run. Empty: all as is."""
        if not self.marked("run as"):
            return []
        names = ("run as", "not run")
        return [
            " ".join(value.split()) if key == "run as" else ""
            for key, value in self.markers
            if key in names
        ]

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


@dataclass(frozen=True)
class Command:
    """One command of a block, and what the page shows of its answer."""

    text: str
    shown: tuple[str, ...] = ()

    @property
    def words(self) -> list[str]:
        """Arguments, without the explanation behind them."""
        return shlex.split(re.split(r"\s{2,}", self.text)[0], comments=True)


def pages() -> list[Path]:
    """The README and every page of the documents."""
    documents = sorted((ROOT / "docs").rglob("*.md"))
    return [ROOT / "README.md", *(page for page in documents if "_build" not in page.parts)]


def blocks_of(text: str, page: str = "page.md") -> list[Block]:
    """Every block of a page that can be run, and every named file, in their order."""
    lines = text.split("\n")
    found: list[Block] = []
    above, start, language = 0, 0, None
    for number, line in enumerate(lines):
        fence = FENCE.match(line)
        if language is not None:
            if fence:
                content = "\n".join(lines[start:number]) + "\n"
                found += _block(
                    page, start + 1, KINDS.get(language), content, lines[above : start - 1]
                )
                language, above = None, number + 1
        elif fence:
            language, start = fence[1].strip(), number + 1
        elif INDENTED.match(line) and not INDENTED.match(lines[number - 1]):
            end = number
            while end < len(lines) and INDENTED.match(lines[end]):
                end += 1
            content = "".join(one.strip() + "\n" for one in lines[number:end])
            found += _block(page, number + 1, "shell", content, lines[above:number])
            above = end
    return found


def _block(page: str, line: int, kind: str | None, text: str, before: list[str]) -> list[Block]:
    if kind is None:
        return []
    return [Block(page, line, kind, text, _markers("\n".join(before).rstrip()))]


def _markers(before: str) -> tuple[tuple[str, str], ...]:
    """The comments that directly precede a block; blank lines between do not matter."""
    found: list[tuple[str, str]] = []
    while before.endswith("-->"):
        start = before.rindex("<!--")
        comment = before[start:]
        if marker := MARKER.fullmatch(comment):
            found.insert(0, (marker[1], marker[2]))
        elif ANYTHING.fullmatch(comment):
            raise ValueError(f"no marker of an example: {comment}")
        before = before[:start].rstrip()
    return tuple(found)


def commands_of(block: Block) -> list[Command]:
    """Commands of a block; of a console those behind `$ `, with the lines below them."""
    if block.kind == "shell":
        lines = block.text.replace("\\\n", " ").splitlines()
        return [Command(line) for line in lines if line.split("#")[0].strip()]
    commands: list[Command] = []
    for line in block.text.splitlines():
        if line.startswith("$ "):
            commands.append(Command(line.removeprefix("$ ")))
        elif commands:
            commands[-1] = Command(commands[-1].text, (*commands[-1].shown, line))
    return commands


def file_of(block: Block) -> tuple[str, str] | None:
    """Name and content of a file that a block holds, or None when its first line names none."""
    first, _, rest = block.text.partition("\n")
    name = NAME_OF_FILE.match(first)
    return (name[1], rest) if name else None


def all_blocks() -> list[Block]:
    """The blocks of every page."""
    return [
        block
        for page in pages()
        for block in blocks_of(page.read_text(encoding="utf-8"), str(page.relative_to(ROOT)))
    ]


def main() -> None:
    """Print what is not run as it stands."""
    for block in all_blocks():
        for name in ("not run", "run by", "run as", "needs"):
            for value in block.marked(name):
                print(f"{block.place}  {name}: {value}")


if __name__ == "__main__":
    main()
