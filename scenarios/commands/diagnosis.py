"""`benchtwin diagnose`: where the sim-to-real gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.commands.common import cache_of, digests, said_of, write_json
from scenarios.commands.diagnosis_other import diagnose_other, fluorescence_visit
from scenarios.console import Console
from scenarios.maps import appearance_maps
from scenarios.outputs import prepare_file, prepare_folder
from scenarios.scenario import MapSettings
from twin.errors import InputError
from twin.files import write_atomically

if TYPE_CHECKING:
    from diagnosis.rounds import Rounds
    from twin.measurement import Measurement

REPORT, RESULT, BENCH = "diagnosis.html", "diagnosis.json", "bench.toml"
"""Names of the files in an output folder."""
MAPS = MapSettings(albedo_count=30, sigma_t_count=40, g_count=6, paths=2048)
"""Of the maps that say what the finite bench does: their own error is in the covariance."""
QUICK_MAPS = MapSettings(albedo_count=12, sigma_t_count=14, g_count=4, paths=512)
PATHS, QUICK_PATHS = 8192, 1024
"""Of the Monte Carlo's responses to effects."""


def diagnose_file(
    path: Path,
    *,
    bench: Path | None = None,
    out: Path | None = None,
    report: Path | None = None,
    rounds: int = 1,
    without: Sequence[str] = (),
    dilutions: bool = False,
    threads: int | None = None,
    cache: Path | None = None,
    quick: bool = False,
    as_json: bool = False,
    console: Console | None = None,
) -> dict[str, Any]:
    """Diagnose a measurement on disk.

    Args:
        path: of the measurement.
        bench: a bench.toml in place of the measurement's own description.
        out: folder of the results.
        report: file of the report; None puts it into the folder.
        rounds: diagnoses, at most; after each the leading effect is accepted.
        without: effects that the catalogue shall not have.
        dilutions: the rows of an .rxt file are dilutions of one stock.
        threads: of the Monte Carlo; the result does not depend on them.
        cache: folder of maps and responses.
        quick: coarse maps and fewer paths.
        as_json: return what the JSON file holds, else lines for a person.
        console: is told what happens; None says nothing.

    Raises:
        InputError: the measurement, the bench, an effect's name or an output cannot be used.
    """
    from diagnosis.rounds import diagnose_rounds, one_thickness
    from diagnosis.translucent import physical
    from scenarios.report_diagnosis import Named, diagnosis_page, terminal
    from scenarios.report_diagnosis import as_json as facts_of
    from scenarios.report_diagnosis.colour import colour_change
    from twin.effects import catalogue
    from twin.measurement import read_measurement

    console = console or Console(quiet=True)
    if rounds < 1:
        raise InputError(f"{rounds} rounds", "1 or more", place="--rounds")
    spheres, visit = path.suffix.lower() == ".rxt", fluorescence_visit(path)
    if spheres or visit is not None:
        given = {"--bench": bench, "--rounds": rounds > 1, "--quick": quick}
        refused = [name for name, value in given.items() if value]
        refused += ["--dilutions"] if dilutions and not spheres else []
        return diagnose_other(
            path, visit, out=out, report=report, without=without, dilutions=dilutions,
            refused=refused, as_json=as_json, console=console,
        )  # fmt: skip
    if dilutions:
        raise InputError(
            "--dilutions for the translucent bench", "an .rxt file", place="--dilutions"
        )
    effects = catalogue().without(without)
    measurement = read_measurement(path)
    if bench is not None:
        measurement = with_bench(measurement, bench)
    cache = None if cache is None else cache_of(cache)
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-diagnosis"))
    page_file = prepare_file(report) if report is not None else folder / REPORT
    with said_of(path):
        # One thickness, or equal ones, cannot show a gap: no map is needed to say so.
        maps = () if one_thickness(measurement) else appearance_maps(
            measurement.bench.model_copy(update={"effects": ()}), measurement.samples,
            np.asarray(measurement.wavelength_nm), QUICK_MAPS if quick else MAPS, cache=cache,
            threads=threads, console=console,
        )  # fmt: skip
        path_of_rounds = diagnose_rounds(
            measurement, most=rounds, effects=effects, maps=maps, folder=cache, threads=threads,
            paths=QUICK_PATHS if quick else PATHS, say=console.say, step=console.step,
        )  # fmt: skip
    named = Named.of(path_of_rounds.first.case.suspects)
    with console.step("colours and pictures"):
        colour = colour_change(measurement, path_of_rounds, physical)
        page = diagnosis_page(measurement, path_of_rounds, colour, bench_file=BENCH)
    write_atomically(page_file, page.encode("utf-8"))
    write_atomically(folder / BENCH, bench_text(path_of_rounds).encode("utf-8"))
    facts = {
        "command": "diagnose",
        "measurement_fingerprint": measurement.fingerprint,
        **facts_of(path_of_rounds, named, colour),
        "without": list(without),
    }
    facts["files"] = digests(folder, [BENCH, *([REPORT] if report is None else [])])
    write_json(folder / RESULT, facts)
    if as_json:
        return {"folder": str(folder), "report": str(page_file), **facts}
    answer = terminal(path_of_rounds, named, colour)
    return {**answer, "report": str(page_file), "bench with what was found": str(folder / BENCH)}


def with_bench(measurement: Measurement, path: Path) -> Measurement:
    """The measurement as taken on another bench; without an instrument there, it keeps its own.

    Raises:
        InputError: a file that is no bench, or effects that these samples cannot have.
    """
    from twin.bench import Bench
    from twin.effects import World
    from twin.toml import parse_table, read_text, validate

    table = parse_table(read_text(path), file=path)
    if isinstance(table.get("instrument"), dict):
        table["instrument"].setdefault("kind", "spectrometer")
    bench = validate(table, Bench, file=path)
    if "instrument" not in table:
        bench = bench.model_copy(update={"instrument": measurement.bench.instrument})
    with said_of(path):
        World.nominal(bench, measurement.samples)
    return replace(measurement, bench=bench)


def bench_text(rounds: Rounds) -> str:
    """The bench with all that was accepted as TOML, which reads back as the same bench."""
    from scenarios.report_diagnosis.words import accepted_text
    from twin.measurement.written import bench_toml

    said = [f"# accepted: {accepted_text(each)}" for each in rounds.accepted]
    head = "\n".join(["# The bench as benchtwin diagnose left it.", *said])
    return f"{head}\n{bench_toml(rounds.bench)}"
