"""files.toml: what the names of exported spectra say."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from twin.errors import InputError
from twin.measurement.model import CAPTURES, SAMPLE_CAPTURES, label
from twin.spectra import Part
from twin.toml import near_misses

FILE = "files.toml"
NOT_SPECTRA = frozenset({"bench.toml", "samples.csv", "samples.toml", FILE})
_PLACEHOLDERS = {
    "sample": r"(?P<sample>.+?)",
    "capture": r"(?P<capture>.+?)",
    "repeat": r"(?P<repeat>\d{1,6})",
    "integration_s": r"(?P<integration_s>\d+(?:\.\d+)?)",
    "integration_ms": r"(?P<integration_ms>\d+(?:\.\d+)?)",
}
_IN_PATTERN = re.compile(r"\{(\w*)\}|(\*)|([^{}*]+)|(.)")


class NamedFiles(Part):
    """files.toml: what the names of the files say."""

    pattern: str | tuple[str, ...]
    """Name of a file with {sample}, {capture}, {repeat}, {integration_s} or {integration_ms}; a *
    stands for any text. Several patterns where references are named otherwise."""
    samples: dict[str, str] = Field(default_factory=dict)
    """What the names call a sample -> its name in samples.csv; others are called as there."""
    captures: dict[str, str] = Field(default_factory=dict)
    """What the names call a capture -> dark, white_reference ...; others are called so."""
    ignore: tuple[str, ...] = ()
    """Names of files that fit the pattern's ending and are no spectra."""
    integration_s: float | None = Field(default=None, gt=0)
    """Integration time [s] of files whose head and name do not say it."""
    integration_unit: Literal["s", "ms", "us"] | None = None
    """Unit of .ACQUISITION TIME in JCAMP-DX files, which do not say it."""
    block: int | None = Field(default=None, ge=1)
    """Which spectrum of JCAMP-DX files that hold several, from 1."""

    @field_validator("pattern")
    @classmethod
    def _known(cls, value: str | tuple[str, ...]) -> str | tuple[str, ...]:
        patterns = (value,) if isinstance(value, str) else value
        if not patterns:
            raise ValueError("found no pattern; expected one or more")
        for pattern in patterns:
            names = re.findall(r"\{(\w*)\}", pattern)
            for name in names:
                if name not in _PLACEHOLDERS:
                    raise ValueError(
                        f"found the placeholder {{{name}}}; expected some of"
                        f" {', '.join(f'{{{each}}}' for each in _PLACEHOLDERS)}"
                    )
            if "capture" not in names or len(set(names)) < len(names):
                raise ValueError(
                    f"found the pattern {pattern!r}; expected {{capture}} in it, and every"
                    " placeholder once"
                )
            rest = re.sub(r"\{\w*\}", "", pattern)
            if re.search(r"[/\\{}]", rest) or not re.fullmatch(r"\.\w+", Path(pattern).suffix):
                raise ValueError(
                    f"found the pattern {pattern!r}; expected the name of a file in this folder,"
                    " with an ending such as .txt"
                )
        return value

    @field_validator("captures")
    @classmethod
    def _captures(cls, value: dict[str, str]) -> dict[str, str]:
        for each in value.values():
            if each not in CAPTURES:
                raise ValueError(f"found the capture {each!r}; expected one of {_list(CAPTURES)}")
        return value

    @property
    def patterns(self) -> tuple[str, ...]:
        """The patterns."""
        return (self.pattern,) if isinstance(self.pattern, str) else self.pattern


@dataclass(frozen=True, slots=True)
class Named:
    """What the name of one file says."""

    path: Path
    capture: str
    sample: str
    repeat: int
    integration_s: float | None


def _list(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names)


def named_files(folder: Path, rules: NamedFiles, known: list[str]) -> list[Named]:
    """What the name of every spectrum in a folder says.

    Args:
        folder: the folder.
        rules: its files.toml.
        known: names of the samples.

    Raises:
        InputError: a name that says nothing or two things, or no spectrum at all.
    """
    samples = {name: name for name in known} | rules.samples
    captures = {name: name for name in CAPTURES} | rules.captures
    endings = {Path(pattern).suffix.lower() for pattern in rules.patterns}
    found = []
    for path in sorted(folder.iterdir()):
        if path.name in NOT_SPECTRA or path.name in rules.ignore or not path.is_file():
            continue
        if path.suffix.lower() in endings and not path.name.startswith("."):
            found.append(_one(path, rules, samples, captures))
    if not found:
        raise InputError("no spectrum", f"files named {' or '.join(rules.patterns)}", file=folder)
    return found


def _one(
    path: Path, rules: NamedFiles, samples: Mapping[str, str], captures: Mapping[str, str]
) -> Named:
    """What a name says, when it says one thing only."""
    meanings = {
        meaning: None
        for pattern in rules.patterns
        for meaning in _meanings(path, pattern, samples, captures)
    }
    if len(meanings) > 1:
        both = " or ".join(
            f"{label(each.capture, each.sample)}, repeat {each.repeat}" for each in meanings
        )
        raise InputError(
            f"a name that can mean {both}", "a name that means one thing", file=path,
            remedy="Rename it, or tell the parts of the pattern apart by another character.",
        )  # fmt: skip
    for meaning in meanings:
        return meaning
    raise _meaningless(path, rules, samples, captures)


def _meanings(
    path: Path, pattern: str, samples: Mapping[str, str], captures: Mapping[str, str]
) -> Iterator[Named]:
    """Every reading of a name in which sample and capture are known ones."""
    with_sample = "{sample}" in pattern
    for sample, its_name in samples.items() if with_sample else (("", ""),):
        for capture, what in captures.items():
            match = _regex(pattern, {"sample": sample, "capture": capture}).fullmatch(path.name)
            if match is None:
                continue
            groups = match.groupdict()
            time_s = None
            if groups.get("integration_s"):
                time_s = float(groups["integration_s"])
            elif groups.get("integration_ms"):
                time_s = round(float(groups["integration_ms"]) * 1e-3, 12)
            yield Named(path, what, its_name, int(groups.get("repeat") or 0), time_s)


def _regex(pattern: str, fixed: Mapping[str, str]) -> re.Pattern[str]:
    """The pattern as a regular expression, with some placeholders replaced by what they hold."""
    parts = []
    for name, star, text, other in _IN_PATTERN.findall(pattern):
        if name:
            parts.append(re.escape(fixed[name]) if name in fixed else _PLACEHOLDERS[name])
        else:
            parts.append(".*" if star else re.escape(text or other))
    return re.compile("".join(parts), re.DOTALL)


def _meaningless(
    path: Path, rules: NamedFiles, samples: Mapping[str, str], captures: Mapping[str, str]
) -> InputError:
    """Why a name says nothing: another capture or sample, or another shape altogether."""
    for pattern in rules.patterns:
        match = _regex(pattern, {}).fullmatch(path.name)
        if match is None:
            continue
        groups = match.groupdict()
        capture, sample = groups["capture"], groups.get("sample")
        if sample is not None and sample not in samples:
            return InputError(
                f"a name with the sample {sample!r}", f"one of {_list(list(samples))}", file=path,
                remedy=near_misses(sample, list(samples)),
            )  # fmt: skip
        return InputError(
            f"a name with the capture {capture!r}", f"one of {_list(list(captures))}", file=path,
            remedy=near_misses(capture, list(captures)),
        )  # fmt: skip
    return InputError(
        "a name that does not fit", " or ".join(rules.patterns), file=path,
        remedy=f"Rename it, or list it under `ignore` in {FILE} when it is no spectrum.",
    )  # fmt: skip


def check_complete(folder: Path, rules: NamedFiles, named: list[Named], known: list[str]) -> None:
    """Refuse a gap in the numbers of repeats, and a sample without one of its captures.

    Raises:
        InputError: says what is missing, and how it would be named.
    """
    groups: dict[tuple[str, str, float | None], dict[int, Path]] = {}
    for each in named:
        key = (each.capture, each.sample, each.integration_s)
        other = groups.setdefault(key, {}).get(each.repeat)
        if other is not None:
            raise InputError(
                f"two files that are {label(each.capture, each.sample)}, repeat {each.repeat}:"
                f" {other.name} and {each.path.name}", "one of them", file=folder,
            )  # fmt: skip
        groups[key][each.repeat] = each.path
    numbered: dict[tuple[str, str], dict[int, Path]] = {}
    for (capture, sample, _), own in groups.items():
        # Darks at several times may be counted together, or each time by itself.
        numbered.setdefault((capture, sample), {}).update(own)
    for (capture, sample), files in numbered.items():
        first = min(files)
        gap = next((n for n in range(first, max(files)) if n not in files), None)
        if first > 1 or gap is not None:
            missing = 1 if first > 1 else gap
            raise InputError(
                f"no repeat {missing} of {label(capture, sample)}, though there is"
                f" {files[max(files)].name}", "repeats numbered without a gap, from 0 or 1",
                file=folder,
            )  # fmt: skip
    there = {(each.capture, each.sample) for each in named}
    for sample in known:
        for capture in SAMPLE_CAPTURES:
            if (capture, sample) not in there:
                raise InputError(
                    f"no file for {label(capture, sample)}",
                    f"one named like {_example(rules, capture, sample)}", file=folder,
                )  # fmt: skip
    for capture in ("dark", "white_reference", "beam_reference"):
        if not any(each.capture == capture for each in named):
            raise InputError(
                f"no file for any {capture}",
                f"one named like {_example(rules, capture, known[0])}", file=folder,
            )  # fmt: skip


def _example(rules: NamedFiles, capture: str, sample: str) -> str:
    """A name that a file could have."""
    called = {name: alias for alias, name in (rules.captures | rules.samples).items()}
    pattern = next((p for p in rules.patterns if "{sample}" in p), rules.patterns[0])
    values = {
        "sample": called.get(sample, sample), "capture": called.get(capture, capture),
        "repeat": "0", "integration_s": "0.1", "integration_ms": "100",
    }  # fmt: skip
    return re.sub(r"\{(\w+)\}", lambda match: values[match[1]], pattern)
