"""`benchtwin diagnose` of readings with integrating spheres and of fluorescence visits.

They are diagnosed by the same statistics and get the same report; rounds and proposals are the
translucent bench's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.commands.common import write_json
from scenarios.console import Console
from scenarios.outputs import file_digest, prepare_file, prepare_folder
from twin.errors import InputError
from twin.files import write_atomically

if TYPE_CHECKING:
    from diagnosis import Diagnosis
    from scenarios.report_diagnosis import Named
    from twin.fluorescence import FluorescenceVisit

RESULT, REPORT = "diagnosis.json", "diagnosis.html"


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
    report: Path | None,
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
        out: folder of the results.
        report: file of the report; None puts it into the folder.
        without: effects that the catalogue shall not have.
        dilutions: the rows of an .rxt file are dilutions of one stock.
        refused: options that were given and mean nothing here.
        as_json: return what the JSON file holds, else lines for a person.
        console: is told what happens.

    Raises:
        InputError: the measurement, an option or the folder cannot be used.
    """
    from scenarios.report_diagnosis.words import OF_SAMPLES, UNDER_LIGHTS, headline

    if refused:
        raise InputError(
            f"{', '.join(refused)} for {'spheres' if visit is None else 'a fluorescence visit'}",
            "options that serve every kind of measurement: --out, --report, --without, --json,"
            " --quiet",
            place=refused[0],
            remedy="Rounds, a quick first look and another bench.toml are the translucent bench's.",
        )
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-diagnosis"))
    page_file = prepare_file(report) if report is not None else folder / REPORT
    reasons: list[str] = []
    with console.step("diagnosis and report"):
        named, found, page = (
            _spheres(path, without, dilutions, reasons)
            if visit is None
            else _fluorescence(path, visit, without, reasons)
        )
    write_atomically(page_file, page.encode("utf-8"))
    belongs = OF_SAMPLES if visit is None else UNDER_LIGHTS
    facts = {
        "command": "diagnose",
        "kind": "spheres" if visit is None else "fluorescence",
        **_named(found.as_json(), named),
        "sentence": headline(found, named),
        "without": list(without),
        "reasons": reasons,
    }
    write_json(folder / RESULT, facts)
    if as_json:
        return {"folder": str(folder), "report": str(page_file), **facts}
    return {**_lines(found, named, belongs), "assumed": reasons, "report": str(page_file)}


def _spheres(
    path: Path, without: Sequence[str], dilutions: bool, reasons: list[str]
) -> tuple[Named, Diagnosis, str]:
    from diagnosis import diagnose
    from diagnosis.sphere_effects import without as catalogue_without
    from diagnosis.spheres import sphere_case
    from scenarios.report_diagnosis.other_page import sphere_names, sphere_page
    from twin.measurement.rxt import read_rxt

    case = sphere_case(
        read_rxt(path), dilutions=dilutions, effects=catalogue_without(without), say=reasons.append
    )
    reasons += case.reasons
    found = diagnose(case.problem)
    named = sphere_names([each.name for each in case.problem.candidates])
    page = sphere_page(
        case, found, named, heading=path.name, fingerprint=file_digest(path), reasons=reasons
    )
    return named, found, page


def _fluorescence(
    path: Path, visit: FluorescenceVisit, without: Sequence[str], reasons: list[str]
) -> tuple[Named, Diagnosis, str]:
    from diagnosis.fluorescence import diagnosed_fluorescence, fluorescence_case
    from scenarios.report_diagnosis.other_page import fluorescence_names, fluorescence_page
    from twin.effects import catalogue

    effects = catalogue().without(without)
    case, found = diagnosed_fluorescence(visit, effects=effects, say=reasons.append)
    reasons += [reason for reason in case.reasons if reason not in reasons]
    named = fluorescence_names(case, visit.setup.detector.wavelength_nm)
    # The case is linearised about what leads; the matrix without it is that of a fit of its own.
    before = fluorescence_case(visit, effects=effects).matrix()
    page = fluorescence_page(
        case, found, named, before, heading=visit.sample or path.name,
        fingerprint=visit.fingerprint, reasons=reasons,
    )  # fmt: skip
    return named, found, page


def _named(facts: dict[str, Any], named: Named) -> dict[str, Any]:
    """The JSON file's keys with every effect's title."""
    for effect in facts["effects"]:
        effect["title"] = named(effect["name"])
    return facts


def _lines(found: Diagnosis, named: Named, belongs: tuple[str, str]) -> dict[str, Any]:
    from scenarios.report_diagnosis.words import (
        closure_sentences,
        effect_rows,
        headline,
        where_sentences,
    )

    answer: dict[str, Any] = {"verdict": headline(found, named)}
    if found.effects and found.verdict != "no_gap":
        answer["effects"] = effect_rows(found, named)
    if found.null is not None:
        answer["where"] = where_sentences(found, belongs)
    if found.closure is not None:
        answer["how_far"] = closure_sentences(found, None)
    if hidden := [each.name for each in found.not_identifiable]:
        answer["not_identifiable"] = f"{len(hidden)} effects cannot be seen in these data: " + (
            ", ".join(hidden)
        )
    return answer
