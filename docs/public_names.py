"""A Sphinx directive that shows what packages export: `{public-names} twin`.

Everything comes from the code: names of `__all__`, signatures, docstrings in Google style.
Docstrings are read as text with backticks, never as markup, so that none can break the build.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PART = re.compile(r"^(Args|Attributes|Returns|Yields|Raises|Example|Examples):\s*$")
ENTRY = re.compile(r"^(\*{0,2}[\w.,\[\]\" ]+?)(?: \([^)]*\))?: (.*)$")
LONGEST = 84


def packages_of(name: str) -> list[str]:
    """A package and every package inside it that exports something."""
    path = importlib.import_module(name).__path__
    names = [name, *(m.name for m in pkgutil.walk_packages(path, f"{name}.") if m.ispkg)]
    return [each for each in names if getattr(importlib.import_module(each), "__all__", ())]


def inline(text: str) -> list[nodes.Node]:
    """Text with what stands between backticks as code."""
    parts = re.split(r"`+([^`]+)`+", " ".join(text.split()))
    return [
        nodes.literal(text=part) if number % 2 else nodes.Text(part)
        for number, part in enumerate(parts)
        if part
    ]


def documentation(text: str) -> Iterator[nodes.Node]:
    """A docstring in Google style as paragraphs, definition lists and indented text."""
    part = None
    for block in re.split(r"\n\s*\n", text.strip("\n")):
        lines = block.splitlines()
        while lines:
            if found := PART.match(lines[0]):
                part = found[1]
                yield nodes.rubric(text=part)
                lines = lines[1:]
                continue
            end = next((i for i, line in enumerate(lines) if i and PART.match(line)), len(lines))
            own, lines = lines[:end], lines[end:]
            indented = all(line.startswith("    ") for line in own)
            if part and indented:
                yield _entries([line[4:] for line in own])
            elif indented:
                yield _code("\n".join(line[4:] for line in own))
            else:
                part = None
                yield nodes.paragraph("", "", *inline(" ".join(own)))


def _entries(lines: list[str]) -> nodes.Node:
    """`name: what it is` with continued lines, as a list; anything else as a paragraph."""
    joined: list[str] = []
    for line in lines:
        if joined and line.startswith(" "):
            joined[-1] += " " + line.strip()
        else:
            joined.append(line)
    found = [ENTRY.match(line) for line in joined]
    if not all(found):
        return nodes.paragraph("", "", *inline(" ".join(joined)))
    listed = nodes.bullet_list()
    for entry in found:
        if entry:
            words = [nodes.literal(text=entry[1]), nodes.Text(": "), *inline(entry[2])]
            listed += nodes.list_item("", nodes.paragraph("", "", *words))
    return listed


def _code(text: str, language: str = "text") -> nodes.literal_block:
    return nodes.literal_block(text, text, language=language, force=True)


def signature(name: str, item: Any) -> str:
    """How a function or class is called, with at most one argument a line where it is long."""
    try:
        found = inspect.signature(item)
    except (TypeError, ValueError):
        return name
    own = [one for one in found.parameters.values() if one.name != "self"]
    shown = [_plain(str(one)) for one in own]
    star = next((i for i, one in enumerate(own) if one.kind is one.KEYWORD_ONLY), None)
    if star is not None and not any(one.kind is one.VAR_POSITIONAL for one in own):
        shown.insert(star, "*")
    answer = found.return_annotation
    arrow = "" if answer is found.empty or inspect.isclass(item) else " -> " + _words(answer)
    line = f"{name}({', '.join(shown)}){arrow}"
    if len(line) <= LONGEST:
        return line
    return f"{name}(\n" + "".join(f"    {each},\n" for each in shown) + f"){arrow}"


def _words(annotation: Any) -> str:
    return _plain(
        annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    )


def _plain(text: str) -> str:
    """Annotations without quotes, values without addresses."""
    text = re.sub(r": '([^']*)'", r": \1", text)
    text = re.sub(r" at 0x[0-9a-f]+", "", text)
    return re.sub(r"\b(?:typing|collections\.abc|pathlib|numpy)\.", "", text)


class PublicNames(SphinxDirective):
    """Sections for a package and the packages inside it."""

    required_arguments: ClassVar[int] = 1  # type: ignore[misc]

    def run(self) -> list[nodes.Node]:
        """Make the sections."""
        return [self._package(name) for name in packages_of(self.arguments[0])]

    def _package(self, name: str) -> nodes.Node:
        module = importlib.import_module(name)
        section = nodes.section("", nodes.title("", "", nodes.literal(text=name)), ids=[name])
        section += list(documentation(inspect.getdoc(module) or ""))
        for each in sorted(module.__all__, key=str.lower):
            section += self._name(f"{name}.{each}", each, getattr(module, each))
        return section

    def _name(self, path: str, name: str, item: Any) -> nodes.Node:
        section = nodes.section("", nodes.title("", "", nodes.literal(text=name)), ids=[path])
        if inspect.isclass(item) or inspect.isfunction(item):
            section += _code(signature(name, item), "python")
            section += list(documentation(inspect.getdoc(item) or ""))
        elif inspect.ismodule(item):
            section += nodes.paragraph("", "", *inline(f"The module `{item.__name__}`."))
        else:
            value = _plain(" ".join(repr(item).split()))
            shown = value if len(value) <= 4 * LONGEST else value[: 4 * LONGEST] + " ..."
            section += nodes.paragraph(
                "", "", *inline(f"A constant of type `{type(item).__name__}`:")
            )
            section += _code(shown)
        if inspect.isclass(item):
            section += list(self._members(item))
        return section

    def _members(self, item: type) -> Iterator[nodes.Node]:
        """Methods and properties that the class itself has."""
        for name, value in vars(item).items():
            inner = getattr(value, "__func__", getattr(value, "fget", None) or value)
            if name.startswith("_") or not inspect.isfunction(inner) or not inspect.getdoc(inner):
                continue
            head = name if isinstance(value, property) else signature(name, inner)
            entry = nodes.definition_list_item(
                "",
                nodes.term("", "", nodes.literal(text=" ".join(head.split()))),
                nodes.definition("", *documentation(inspect.getdoc(inner) or "")),
            )
            yield nodes.definition_list("", entry)


def setup(app: Sphinx) -> dict[str, bool]:
    """Announce the directive."""
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
