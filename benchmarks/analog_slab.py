"""Analog slab: a plain second Monte Carlo that judges the reference values which disagree.

Double precision, analog, no connections, no tables, no sorting: photons fly, scatter, reflect
and leave, and are counted by exit angle and by number of scattering events. It shares nothing
with `twin.transport` but the physics. `benchmarks.references` names the rows it was asked about.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from twin.spectra import FloatArray

BATCH = 100_000
MAX_EVENTS = 4000


@dataclass(frozen=True)
class Question:
    """Transmittance into a cone around the normal, light arriving along the normal."""

    row: str
    n: float
    optical_thickness: float
    g: float
    albedo: float
    cone_deg: float


QUESTIONS = tuple(
    Question(f"iad_CONE_a{albedo}_b4_g0.9_n1.5_5deg_Tcone", 1.5, 4.0, 0.9, albedo, 5.0)
    for albedo in (0.9, 0.999)
)


def fresnel(n1: float, n2: float, cosine: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unpolarised reflectance and refracted cosine (Born and Wolf 1999, section 1.5.2)."""
    sine_squared = (n1 / n2) ** 2 * (1.0 - cosine**2)
    refracted = np.sqrt(np.maximum(0.0, 1.0 - sine_squared))
    s = (n1 * cosine - n2 * refracted) / (n1 * cosine + n2 * refracted)
    p = (n2 * cosine - n1 * refracted) / (n2 * cosine + n1 * refracted)
    return np.where(sine_squared >= 1.0, 1.0, 0.5 * (s**2 + p**2)), refracted


def transmitted(question: Question, photons: int, seed: int) -> FloatArray:
    """Photons that leave within the cone, by number of scattering events."""
    generator = np.random.Generator(np.random.Philox(key=seed))
    n, g, depth = question.n, question.g, question.optical_thickness
    inside = math.cos(math.radians(question.cone_deg))
    # only the polar angle matters in an unbounded slab: depth and direction cosine are the state
    at = np.zeros(photons)
    mu = np.ones(photons)
    count = np.zeros(photons, dtype=np.int64)
    # what is reflected on arrival goes up and is not asked for
    entered = generator.random(photons) >= fresnel(1.0, n, np.ones(1))[0][0]
    at, mu, count = at[entered], mu[entered], count[entered]
    tally = np.zeros(MAX_EVENTS)
    while at.size:
        flight = -np.log1p(-generator.random(at.size))
        with np.errstate(divide="ignore"):
            to_face = np.where(mu > 0.0, (depth - at) / mu, -at / mu)
        scatters = flight < to_face
        faces = ~scatters
        at = np.where(scatters, at + flight * mu, np.where(mu > 0.0, depth, 0.0))
        reflectance, outside = fresnel(n, 1.0, np.abs(mu))
        leaves = faces & (generator.random(at.size) >= reflectance)
        counted = leaves & (mu > 0.0) & (outside >= inside)
        tally += np.bincount(count[counted], minlength=MAX_EVENTS)[:MAX_EVENTS]
        u = generator.random(at.size)
        turned = 2.0 * u - 1.0
        if g != 0.0:
            turned = (1.0 + g * g - ((1.0 - g * g) / (1.0 - g + 2.0 * g * u)) ** 2) / (2.0 * g)
        azimuth = np.cos(2.0 * math.pi * generator.random(at.size))
        across = np.sqrt(np.maximum(0.0, (1.0 - mu**2) * (1.0 - turned**2)))
        after = np.clip(mu * turned + across * azimuth, -1.0, 1.0)
        mu = np.where(scatters, after, np.where(faces & ~leaves, -mu, mu))
        count = count + scatters
        stays = ~leaves & (count < MAX_EVENTS)
        at, mu, count = at[stays], mu[stays], count[stays]
    return tally


def run(quick: bool) -> dict[str, object]:
    """Answers to all questions, with standard errors."""
    started = time.perf_counter()
    batches = 5 if quick else 200
    answers = []
    slabs: dict[tuple[float, ...], FloatArray] = {}
    for question in QUESTIONS:
        key = (question.n, question.optical_thickness, question.g, question.cone_deg)
        if key not in slabs:
            slabs[key] = np.sum(
                [transmitted(question, BATCH, seed) for seed in range(batches)], axis=0
            )
        count, photons = slabs[key], batches * BATCH
        weight = question.albedo ** np.arange(MAX_EVENTS)
        mean = float(count @ weight) / photons
        square = float(count @ weight**2) / photons
        answers.append(
            {
                "row": question.row,
                "value": mean,
                "standard_error": math.sqrt((square - mean**2) / photons),
                "photons": photons,
            }
        )
    return {"answers": answers, "seconds": time.perf_counter() - started}
