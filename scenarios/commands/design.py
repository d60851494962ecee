"""`design`: the cheapest set-up that is good enough, what limits it, what more money buys."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from scenarios.console import Console
from scenarios.outputs import canonical_json, prepare_folder
from scenarios.sweep import Workers
from twin.errors import InputError
from twin.files import write_atomically

RESULT = "design.json"
REPORT = "report.html"
SIMULATIONS = "simulations"


def design_file(
    goal: str,
    *,
    out: Path | None,
    quick: bool,
    simulate: bool,
    workers: Workers,
    as_json: bool,
    console: Console,
) -> dict[str, Any]:
    """Run a design study and write its report, its JSON file and a scenario of every candidate.

    Args:
        goal: a goal that comes with the program, or a TOML file.
        out: folder; None: benchtwin-design-NAME here.
        quick: fewer and coarser simulations.
        simulate: verify leading candidates in full.
        workers: who simulates.
        as_json: what is returned is for a program.
        console: is told how far it is.

    Raises:
        InputError: see `scenarios.design.load_goal` and `study`.
    """
    from scenarios.design import load_goal, study
    from scenarios.report_design import design_page

    asked, parts = load_goal(goal, quick=quick)
    if simulate:
        workers.check()
    folder = out or Path(f"benchtwin-design-{Path(goal).stem}")
    known = folder.exists()
    prepare_folder(folder)
    try:
        found = study(
            asked, parts, folder=folder / SIMULATIONS if simulate else None, workers=workers,
            console=console,
        )  # fmt: skip
    except InputError:
        if not known:
            with suppress(OSError):  # what is in it was worth keeping
                folder.rmdir()
        raise
    facts = found.as_json()
    if not asked.targets.fluorescent:
        for number in dict.fromkeys([found.answer, *found.found.front]):
            own = found.found.candidates[number]
            name = f"{own.id(parts)}.toml"
            write_atomically(prepare_folder(folder / "candidates") / name,
                             own.toml(parts, asked).encode())  # fmt: skip
    write_atomically(folder / RESULT, (canonical_json(facts) + "\n").encode())
    write_atomically(folder / REPORT, design_page(found).encode())
    if as_json:
        return {"folder": str(folder), "report": str(folder / REPORT), **facts}
    answer = {
        "verdict": facts["verdict"],
        "meets targets in simulation": facts["meets_targets_in_simulation"],
        "candidates looked at": facts["search"]["candidates"],
        "price usd": facts["answer"]["price_usd"],
        "figures": facts["answer"]["figures"],
        "compared": {row["name"]: {"price usd": row["price_usd"], **row["figures"]}
                     for row in facts["compared"]},
    }  # fmt: skip
    if facts["verified"]:
        answer["actual over predicted error"] = {
            row["id"]: row.get("ratio", row.get("failure", "")) for row in facts["verified"]
        }
    if not asked.targets.fluorescent:
        answer["scenario"] = str(folder / "candidates" / f"{facts['answer']['id']}.toml")
    return {**answer, "report": str(folder / REPORT)}
