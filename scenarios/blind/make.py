"""Making a sealed suite: materials, effects, visits by the Monte Carlo, labels under seal."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from scenarios.blind.suite import (
    CLOSED,
    MEASUREMENT,
    MEASUREMENTS,
    OPENED,
    SEAL,
    SUITE,
    VERSION,
    Suite,
    read_suite,
)
from scenarios.console import Console
from scenarios.outputs import canonical_json, prepare_folder
from scenarios.sweep import Workers, sweep
from twin.errors import InputError
from twin.files import write_atomically

TASK = "scenarios.blind.make:made"


def make(
    suite: Suite,
    folder: Path,
    *,
    workers: Workers | None = None,
    console: Console | None = None,
) -> dict[str, Any]:
    """Make the measurements of a suite that are not there yet, and seal their labels.

    Args:
        suite: what to make; a folder that has one already must have the same.
        folder: of the suite.
        workers: who works; None: this process.
        console: is told how far it is.

    Returns:
        Number of measurements, and of materials that could not be measured, with the reason.

    Raises:
        InputError: a folder of another suite, one that was opened, or one that cannot be written.
    """
    from scenarios.blind.seal import LABELS, salts_of, seal_of

    prepare_folder(folder)
    if (folder / OPENED).exists():
        raise InputError(
            "a suite whose seals were opened", "a new folder", file=folder,
            remedy="Make another suite, of another seed.",
        )  # fmt: skip
    if (folder / SUITE).exists():
        if read_suite(folder) != suite:
            raise InputError("another suite", "the same suite, or a new folder", file=folder)
    else:
        write_atomically(folder / SUITE, suite.text.encode())
    points = [{"suite": suite.point, "material": material} for material in suite.numbers]
    run = sweep(
        TASK, points, folder / CLOSED, version=VERSION, workers=workers, console=console,
        title="make sealed measurements",
    )  # fmt: skip
    labels: dict[str, Any] = {}
    found: dict[int, bytes] = {}
    for material, result in zip(suite.numbers, run.results(), strict=True):
        if result is None:
            continue
        for arm in suite.arms:
            number = suite.number(material, arm)
            labels[str(number)] = json.loads(bytes(result[f"label {arm}"]).decode())
            found[number] = bytes(result[f"measurement {arm}"])
    salts = salts_of(folder, sorted(found))
    write_atomically(folder / CLOSED / LABELS, (canonical_json(labels) + "\n").encode())
    for number, data in found.items():
        own = folder / MEASUREMENTS / f"{number:04d}"
        if (own / SEAL).exists():
            continue
        own.mkdir(parents=True, exist_ok=True)
        label = labels[str(number)]
        write_atomically(own / MEASUREMENT, data)
        seal = {"sha256": seal_of(label, salts[str(number)]), "without": label["without"]}
        write_atomically(own / SEAL, (canonical_json(seal) + "\n").encode())
    return {
        "measurements": len(found),
        "failed": [{"material": f.number, "reason": f.message} for f in run.failures],
    }


def made(point: dict[str, Any]) -> Mapping[str, Any]:
    """The task: one material in all arms; netCDF files and labels as bytes.

    Args:
        point: the suite, and the number of the material.
    """
    from scenarios.blind.material_bench import MaterialBench
    from twin.measurement import write_measurement

    suite = Suite(**point["suite"])
    bench = MaterialBench.of(suite, int(point["material"]))
    answer: dict[str, Any] = {}
    with TemporaryDirectory() as folder:
        for arm in suite.arms:
            measurement, label = bench.measured(arm)
            path = write_measurement(measurement, Path(folder) / MEASUREMENT)
            answer[f"measurement {arm}"] = np.frombuffer(path.read_bytes(), dtype=np.uint8)
            text = canonical_json(label, indent=None).encode()
            answer[f"label {arm}"] = np.frombuffer(text, dtype=np.uint8)
    return answer
