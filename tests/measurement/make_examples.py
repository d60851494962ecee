"""Make the tables of docs/examples/hand_made and hand_made_relative again.

    python -m tests.measurement.make_examples

Two pieces of one invented teal medium on the bench of the example's bench.toml, by the Monte Carlo;
counts by the default spectrometer, with all its noise and a real lamp's drift, but without its
nonlinearity.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from twin.bench import Bench, Medium, Sample
from twin.instrument import Spectrometer, lamp_drift, simulate_counts
from twin.materials import lamp
from twin.spectra import SpectralTable
from twin.toml import load_toml
from twin.transport import captures

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
WAVELENGTH_NM = np.arange(400.0, 701.0, 20.0)
SIGMA_T_PER_MM, G = 4.0, 0.4
ALBEDO = np.round(0.80 + 0.15 * np.exp(-(((WAVELENGTH_NM - 490) / 55) ** 2)), 4)
THICKNESS_MM = {"teal-thin": 0.5, "teal-thick": 1.0}
AVERAGES, REPEATS, SEED = 10, 2, 2022


def relative() -> tuple[dict[tuple[str, str], np.ndarray], dict[str, np.ndarray]]:
    """Noiseless relative intensities by (capture, sample), and the references' signals."""
    bench = load_toml(EXAMPLES / "hand_made" / "bench.toml", Bench)
    table = SpectralTable(wavelength_nm=tuple(WAVELENGTH_NM), value=tuple(ALBEDO))
    medium = Medium(albedo=table, sigma_t_per_mm=SIGMA_T_PER_MM, g=G)
    spectra = {}
    for name, thickness in THICKNESS_MM.items():
        sample = Sample(name=name, thickness_mm=thickness, n=1.5, material=medium)
        result = captures(bench, sample, WAVELENGTH_NM, paths=262_144, seed=SEED)
        for capture in ("black", "white", "collimated"):
            spectra[capture, name] = getattr(result, capture)
    panels = lamp(bench.panel_spectrum, WAVELENGTH_NM)
    beam = lamp(bench.beam.spectrum, WAVELENGTH_NM)
    references = {
        "dark": 0.0 * panels,
        "white_reference": 4e6 * panels / panels.max(),
        "beam_reference": 4e6 * beam / beam.max(),
    }
    references["black_reference"] = (
        references["white_reference"] * result.rho_black / result.rho_white
    )
    return spectra, references


def main() -> None:
    """Write both tables."""
    spectra, references = relative()
    rho_white = 0.99
    rates = [("dark", "", 0.1), ("dark", "", 0.5), ("white_reference", "", 0.1)]
    rates += [("black_reference", "", 0.1), ("beam_reference", "", 0.1)]
    rates += [(capture, name, 0.5 if capture == "collimated" else 0.1) for capture, name in spectra]
    sensor = Spectrometer(pixels_nm=tuple(WAVELENGTH_NM), off=("nonlinearity",))
    plan = [(repeat, *rate) for repeat in range(REPEATS) for rate in rates]
    drift = [lamp_drift(sensor, len(plan), seed=SEED, lamp=number) for number in (0, 1)]
    rows: list[list[object]] = []
    for shot, (repeat, capture, name, integration) in enumerate(plan):
        if name:
            kind = "beam_reference" if capture == "collimated" else "white_reference"
            scale = 1.0 if capture == "collimated" else 1.0 / rho_white
            rate = spectra[capture, name] * references[kind] * scale
        else:
            rate = references[capture]
        beam = capture in ("beam_reference", "collimated")
        counts = simulate_counts(
            sensor, rate, integration, seed=SEED, shot=shot, lamp=drift[beam][shot]
        ).counts
        for wavelength, value in zip(WAVELENGTH_NM, counts, strict=True):
            cells = [capture, name, repeat, f"{wavelength:g}", f"{value:.1f}"]
            rows.append([*cells, f"{integration:g}", AVERAGES, 10 * shot])
    head = "capture sample repeat wavelength_nm counts integration_s averages time_s"
    _write(EXAMPLES / "hand_made" / "captures.csv", head, rows)

    random = np.random.Generator(np.random.Philox(key=SEED))
    rows = []
    for (capture, name), values in spectra.items():
        sigma = 0.0003 + 0.001 * values
        noisy = values + sigma * random.standard_normal(values.size)
        for wavelength, value, error in zip(WAVELENGTH_NM, noisy, sigma, strict=True):
            rows.append([capture, name, 0, f"{wavelength:g}", f"{value:.5f}", f"{error:.5f}"])
    head = "capture sample repeat wavelength_nm value sigma"
    _write(EXAMPLES / "hand_made_relative" / "relative.csv", head, rows)


def _write(path: Path, head: str, rows: list[list[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head.split())
        writer.writerows(rows)


if __name__ == "__main__":
    main()
