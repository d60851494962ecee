"""TOML files a person writes, read into validated models with errors that say what to do."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from twin.errors import InputError

Model = TypeVar("Model", bound=BaseModel)

_OWN_MESSAGE = re.compile(r"found (?P<found>.*); expected (?P<expected>.*)", re.DOTALL)


def load_toml(path: str | Path, model: type[Model]) -> Model:
    """Read a TOML file into a model.

    Raises:
        InputError: the file cannot be read, is not TOML, or does not fit the model.
    """
    path = Path(path)
    return parse_toml(read_text(path), model, file=path)


def parse_toml(text: str, model: type[Model], *, file: object = "") -> Model:
    """Read TOML text into a model; `file` is what messages call it.

    Raises:
        InputError: the text is not TOML or does not fit the model.
    """
    return validate(parse_table(text, file=file), model, file=file)


def parse_table(text: str, *, file: object = "") -> dict[str, Any]:
    """Read TOML text into a dictionary.

    Raises:
        InputError: the text is not TOML; says the line.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        message = str(error)
        match = re.search(r"\s*\(at (.*)\)$", message)
        place = match.group(1) if match else ""
        reason = message[: match.start()] if match else message
        found = reason[:1].lower() + reason[1:]
        if place == "end of document":
            place = f"line {text.count(chr(10)) + 1} (end of the file)"
        raise InputError(f"a mistake: {found}", "TOML", file=file, place=place) from error


def validate(data: Mapping[str, Any], model: type[Model], *, file: object = "") -> Model:
    """Validate a dictionary that came from a file.

    Raises:
        InputError: it does not fit the model; says the dotted place, found and expected.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise input_error(error, data, model, file=file) from error


def read_text(path: Path) -> str:
    """The UTF-8 text of a file, without a byte-order mark.

    Raises:
        InputError: no such file, not readable, or not UTF-8.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError("no such file", "a file that exists", file=path) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"a file that cannot be read ({reason})", "a file", file=path) from error
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(
            "text in UTF-16", "text in UTF-8", file=path, remedy='Save it again as "UTF-8".'
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(
            f"byte {raw[error.start]:#04x}, which is not UTF-8",
            "text in UTF-8",
            file=path,
            place=f"line {line}",
            remedy='Save it again as "UTF-8".',
        ) from error


def near_misses(found: str, known: Sequence[str]) -> str:
    """A sentence that names what was probably meant, or ""."""
    lower = {name.lower(): name for name in known}
    near = difflib.get_close_matches(found.lower(), list(lower), n=1, cutoff=0.6)
    return f"Did you mean `{lower[near[0]]}`?" if near else ""


def input_error(
    error: ValidationError, data: Any, model: type[BaseModel], *, file: object = ""
) -> InputError:
    """One clear message out of a validation error: the first mistake, and where others are."""
    mistakes: dict[tuple[str | int, ...], list[Any]] = {}
    for item in error.errors(include_url=False):
        place = _place(item["loc"], data, missing=item["type"] == "missing")
        mistakes.setdefault(place, []).append(item)
    # A table that was tried as one branch of a union reports inside that branch too: the deeper
    # place is the mistake, the shallower ones only say that it is not a number or a name.
    places = [
        p for p in mistakes if not any(len(q) > len(p) and q[: len(p)] == p for q in mistakes)
    ]
    # A misspelt key is unknown and leaves another missing: say the first.
    places.sort(key=lambda p: mistakes[p][0]["type"] != "extra_forbidden")
    place = places[0]
    found, expected, remedy = _describe(mistakes[place], place, model)
    if len(places) > 1:
        others = ", ".join(_dotted(other) for other in places[1:4])
        more = ", ..." if len(places) > 4 else ""
        remedy = f"{remedy} Also wrong: {others}{more}.".strip()
    return InputError(found, expected, file=file, place=_dotted(place), remedy=remedy)


def _place(loc: tuple[int | str, ...], data: Any, *, missing: bool) -> tuple[str | int, ...]:
    """The location without the tags of unions that pydantic puts into it."""
    place: list[str | int] = []
    for index, part in enumerate(loc):
        last = index == len(loc) - 1
        inside = (isinstance(data, Mapping) and part in data) or (
            isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]
            place.append(part)
        elif last and missing:
            place.append(part)
    return tuple(place)


def _dotted(place: tuple[str | int, ...]) -> str:
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _describe(
    items: list[Any], place: tuple[str | int, ...], model: type[BaseModel]
) -> tuple[str, str, str]:
    """What was found, what is expected, and a remedy."""
    item = items[0]
    kind = item["type"]
    key = str(place[-1]) if place else ""
    if kind == "extra_forbidden":
        known = _keys_at(model, place[:-1])
        remedy = near_misses(key, known)
        return f"the unknown key `{key}`", f"one of {', '.join(known)}", remedy
    if kind == "missing":
        found = f"no key `{key}`" if isinstance(place[-1], str) else "a list that is too short"
        return found, "it to be there", ""
    # What was tried as a number, a name and a table, and is a table: only its own check matters.
    tried = items if isinstance(item["input"], Mapping) else items[:1]
    own_messages = [each["msg"] for each in tried if each["type"] == "value_error"]
    own = _OWN_MESSAGE.search(own_messages[0]) if own_messages else None
    if own:
        return own["found"], own["expected"], ""
    expected = []
    for each in items:
        text = _EXPECTED.get(each["type"]) or _lowered(each["msg"])
        if text not in expected:
            expected.append(text)
    return _shown(item["input"]), " or ".join(expected), ""


_EXPECTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "finite_number": "a finite number",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "tuple_type": "a list",
    "list_type": "a list",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "none_required": "nothing",
}


def _lowered(message: str) -> str:
    message = re.sub(r"^(Input|Value error,|String|Tuple|Field) (should (be|have) )?", "", message)
    return message[:1].lower() + message[1:]


def _shown(value: Any) -> str:
    text = f"{value:g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _keys_at(model: type[BaseModel], place: tuple[str | int, ...]) -> list[str]:
    """Keys that may stand in the table at a place."""
    models = [model]
    for part in place:
        if isinstance(part, int):
            continue
        fields = [m.model_fields[part] for m in models if part in m.model_fields]
        models = [found for field in fields for found in _models_in(field.annotation)]
    return sorted({key for each in models for key in each.model_fields})


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in get_args(annotation) for found in _models_in(part)]
