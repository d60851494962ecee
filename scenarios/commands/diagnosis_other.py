"""`benchtwin diagnose` of readings with integrating spheres and of fluorescence visits.

They are diagnosed by the same statistics; a report page, rounds and proposals are the translucent
bench's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.commands.common import write_json
from scenarios.console import Console
from scenarios.outputs import prepare_folder
from twin.errors import InputError

if TYPE_CHECKING:
    from diagnosis import Diagnosis
    from scenarios.report_diagnosis import Named
    from twin.fluorescence import FluorescenceVisit

RESULT = "diagnosis.json"


def fluorescence_visit(path: Path) -> FluorescenceVisit | None:
    """The visit to the fluorescence bench that a path holds; None for another kind.

    Raises:
        InputError: it is one, with a mistake in it.
    """
    from twin.fluorescence import is_fluorescence_visit, read_visit

    return read_visit(path) if is_fluorescence_visit(path) else None


def diagnose_other(
    path: Path,
    visit: FluorescenceVisit | None,
    *,
    out: Path | None,
    without: Sequence[str],
    dilutions: bool,
    refused: Sequence[str],
    as_json: bool,
    console: Console,
) -> dict[str, Any]:
    """Diagnose an .rxt file, or a visit to the fluorescence bench.

    Args:
        path: of the measurement.
        visit: what it holds; None for an .rxt file.
        out: folder of the JSON file.
        without: effects that the catalogue shall not have.
        dilutions: the rows of an .rxt file are dilutions of one stock.
        refused: options that were given and mean nothing here.
        as_json: return what the JSON file holds, else lines for a person.
        console: is told what happens.

    Raises:
        InputError: the measurement, an option or the folder cannot be used.
    """
    if refused:
        raise InputError(
            f"{', '.join(refused)} for {'spheres' if visit is None else 'a fluorescence visit'}",
            "options that serve every kind of measurement: --out, --without, --json, --quiet",
            place=refused[0],
            remedy="Rounds, reports and another bench.toml are the translucent bench's.",
        )
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-diagnosis"))
    reasons: list[str] = []
    with console.step("diagnosis"):
        named, found = (
            _spheres(path, without, dilutions, reasons)
            if visit is None
            else _fluorescence(visit, without, reasons)
        )
    facts = {
        "command": "diagnose",
        "kind": "spheres" if visit is None else "fluorescence",
        **found.as_json(),
        "without": list(without),
        "reasons": reasons,
    }
    write_json(folder / RESULT, facts)
    if as_json:
        return {"folder": str(folder), **facts}
    return {**_lines(found, named), "assumed": reasons, "result": str(folder / RESULT)}


def _spheres(
    path: Path, without: Sequence[str], dilutions: bool, reasons: list[str]
) -> tuple[Named, Diagnosis]:
    from diagnosis.spheres import diagnose_spheres
    from scenarios.report_diagnosis import Named

    found = diagnose_spheres(path, dilutions=dilutions, leave_out=without, say=reasons.append)
    return Named({}, {}, {}), found


def _fluorescence(
    visit: FluorescenceVisit, without: Sequence[str], reasons: list[str]
) -> tuple[Named, Diagnosis]:
    from diagnosis.fluorescence import diagnosed_fluorescence
    from scenarios.report_diagnosis import Named
    from twin.effects import catalogue

    effects = catalogue().without(without)
    case, found = diagnosed_fluorescence(visit, effects=effects, say=reasons.append)
    reasons += [reason for reason in case.reasons if reason not in reasons]
    return Named.of(case.suspects), found


def _lines(found: Diagnosis, named: Named) -> dict[str, Any]:
    from scenarios.report_diagnosis.words import effect_rows, headline, where_sentences

    answer: dict[str, Any] = {"verdict": headline(found, named)}
    if found.effects and found.verdict != "no_gap":
        answer["effects"] = effect_rows(found, named)
    if found.null is not None:
        answer["where"] = where_sentences(found)
    if hidden := [each.name for each in found.not_identifiable]:
        answer["not_identifiable"] = f"{len(hidden)} effects cannot be seen in these data: " + (
            ", ".join(hidden)
        )
    return answer
