"""The finished pieces of a checker run, kept by what they were made from, so that it can resume."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult
    from scenarios.console import Console
    from scenarios.scenario import Scenario


def estimated_ink(
    scenario: Scenario,
    ink: str,
    *,
    work: Path | None,
    resume: bool,
    cache: Path | None,
    threads: int | None,
    console: Console,
) -> EstimateResult:
    """Simulate the visit and estimate the ink, or read the same estimate again.

    Raises:
        InputError: an estimator that does not exist, or a folder that cannot be written.
    """
    from estimators import read_netcdf, write_netcdf
    from scenarios.pipeline import check_estimator, estimate_measurement
    from scenarios.simulate import simulate_visit, software
    from twin.cache import content_key
    from twin.errors import InputError

    check_estimator(scenario.estimator)
    key = content_key({"scenario": scenario.text, "software": software()})
    path = None if work is None else work / f"{ink}-{key[:12]}.nc"
    if path is not None and resume and path.exists():
        try:
            found = read_netcdf(path)
        except InputError as error:
            console.say(f"not resumed: {error}")
        else:
            console.say(f"resumed: {path} is used again")
            return found
    with console.step(f"simulate the visit of {ink}") as progress:
        measurement = simulate_visit(scenario, threads=threads, progress=progress)
    result = estimate_measurement(
        measurement,
        scenario.estimator,
        settings=scenario.map,
        cache=cache,
        threads=threads,
        console=console,
    ).result
    if path is not None:
        write_netcdf(result, path)
    return result


def kept_patch(
    simulate: Callable[[], tuple[FloatArray, FloatArray]],
    name: str,
    described: Mapping[str, object],
    work: Path | None,
    resume: bool,
    console: Console,
) -> tuple[FloatArray, FloatArray]:
    """Simulate a patch, or read it again: radiance factor and standard error, shape (W,) each.

    Raises:
        InputError: a folder that cannot be written.
    """
    from scenarios.simulate import software
    from twin.cache import content_key, load_arrays, store_arrays

    if work is None:
        return simulate()
    key = content_key({**described, "software": software()})
    path = work / f"{name.replace(' ', '-')}-{key[:12]}.arrays"
    found = load_arrays(path, console.say) if resume else None
    if found is not None:
        return found["value"], found["error"]
    value, error = simulate()
    store_arrays(path, {"value": value, "error": error})
    return value, error
