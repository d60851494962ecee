"""The kit on every estimator of the registry; what does not apply is stated with its reason."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import pytest

import estimators
from estimators import BeerEstimator, BenchModel, Estimator, LutEstimator, LutSettings
from estimators.kubelka_munk import KubelkaMunkEstimator
from scenarios.strategies import ALL, Make, World, fast_engine, find_faults
from tests.estimators.fake_map import FakeMap, captures, fake_map
from tests.strategies.worlds import two_fluxes
from twin.spectra import FloatArray


def map_world(model: BenchModel, material: FloatArray) -> FloatArray:
    """The closed-form world of the fake appearance map, without the map's interpolation."""
    backgrounds = model.rho_black, model.rho_white
    return np.stack(
        [captures(*material.T, sample.thickness_mm, *backgrounds) for sample in model.samples]
    )


@lru_cache(maxsize=8)
def scaled_map(thickness_mm: float, mean_mm: float) -> FakeMap:
    return fake_map(thickness_mm, shape=(40, 80, 16), sigma_t=(0.04 / mean_mm, 90.0 / mean_mm))


def with_maps(model: BenchModel) -> BenchModel:
    thickness = [sample.thickness_mm for sample in model.samples]
    mean = float(np.mean(thickness))
    return replace(model, maps=tuple(scaled_map(h, mean) for h in thickness))


def lut(model: BenchModel) -> Estimator:
    return LutEstimator(with_maps(model), LutSettings(draws=300, threads=1))


def lut_seed(model: BenchModel) -> Estimator:
    return LutEstimator(with_maps(model), LutSettings.of_the_seed(threads=1))


def by_name(name: str) -> Make:
    return lambda model: estimators.estimator(name, model)


@dataclass(frozen=True)
class Case:
    """How an estimator is tested, and which properties do not apply to it, and why."""

    make: Make
    world: World = fast_engine
    without: Mapping[str, str] = field(default_factory=dict)
    examples: int = 1
    wavelengths: int = 30
    tolerance: float = 0.05


SHARED = {
    one.name: "nelder-mead shows it: the same screening and objective, and by the matrix test the"
    " same minimum"
    for one in ALL
    if one.name not in ("repeatable", "opaque_ignores_background", "no_confident_wrong_answer")
}
CASES = {
    "beer": Case(
        BeerEstimator,
        two_fluxes,
        {"says_when_contradictory": "looks at the collimated capture alone"},
        examples=5,
        wavelengths=300,
    ),
    "kubelka-munk": Case(KubelkaMunkEstimator, two_fluxes, examples=5, wavelengths=300),
    "lut": Case(
        lut,
        map_world,
        examples=2,
        wavelengths=150,
        tolerance=1.0,
    ),
    "lut-seed": Case(
        lut_seed,
        map_world,
        {
            "intervals_cover": "its box of 0.02 is no statement about the noise",
            "says_when_no_noise_is_stated": "its box of 0.02 stands for the noise",
        },
        examples=2,
        tolerance=1.0,
    ),
    "nelder-mead": Case(by_name("nelder-mead")),
    "powell": Case(by_name("powell"), without=SHARED),
    "adam": Case(by_name("adam"), without=SHARED),
    "least-squares": Case(by_name("least-squares"), wavelengths=100),
    "posterior": Case(by_name("posterior"), tolerance=0.5),
}
SLOW = {"least-squares", "posterior"}
"""Estimators that compile an engine for every answer, which takes minutes here: only when the
environment variable BENCHTWIN_SLOW_TESTS is set."""
UNSUITED = {"spheres": "measures with integrating spheres, not on this bench"}


@pytest.mark.parametrize("one", ALL, ids=repr)
@pytest.mark.parametrize("name", CASES)
def test_estimators_have_the_properties(name: str, one) -> None:  # type: ignore[no-untyped-def]
    case = CASES[name]
    if name not in estimators.names():
        pytest.skip(f"the registry has no {name} yet")
    if name in SLOW and not os.environ.get("BENCHTWIN_SLOW_TESTS"):
        pytest.skip("compiles its engine anew for every answer; set BENCHTWIN_SLOW_TESTS")
    if one.name in case.without:
        pytest.skip(case.without[one.name])
    faults = find_faults(
        case.make,
        [one],
        world=case.world,
        examples=case.examples,
        wavelengths=case.wavelengths,
        tolerance=case.tolerance,
    )
    assert [str(fault) for fault in faults] == []


def test_every_estimator_of_the_registry_is_tested() -> None:
    assert set(estimators.names()) - set(UNSUITED) <= set(CASES)


def test_what_is_left_out_is_a_property() -> None:
    names = {one.name for one in ALL}
    assert {left for case in CASES.values() for left in case.without} <= names
