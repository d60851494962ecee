"""How many LEDs, backgrounds and thicknesses: the information of several designs of one case."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from scenarios.fluorescent_translucent.case import Case
from scenarios.fluorescent_translucent.simulate import TrueCaptures, led_visit, white_visit
from twin.bench import Sample

if TYPE_CHECKING:
    from estimators.translucent_fluorescence import FluorescentForward, State
    from estimators.translucent_fluorescence.information import DesignInformation

BOTH, WHITE_ONLY, BLACK_ONLY = slice(0, 2), slice(1, 2), slice(0, 1)
THICKEST = Sample(name="thickest", thickness_mm=2.0, n=1.45)
FLOOR = 1e-6
"""Excitation [1/mm] and emission [1/nm] below which spectra count as dark."""


def fast_light(case: Case) -> TrueCaptures:
    """The case's light by the plane-parallel engine, without any error."""
    from twin.bispectral import donaldson

    found = donaldson(case.bench, case.samples, case.properties)
    emitted = found.fluorescent[:, :2]
    nothing = (np.zeros_like(found.elastic), np.zeros_like(emitted))
    return TrueCaptures(found.elastic, emitted, *nothing)


def true_state(case: Case, model: FluorescentForward) -> State:
    """The case's medium in the coordinates of the fit, as near as its splines come."""
    from estimators.translucent_fluorescence import State

    own = case.properties
    host = np.stack(
        [
            np.log(own.absorption_per_mm + own.fluorophore_per_mm),
            np.log(own.scattering_per_mm * (1.0 - own.g)),
            np.arctanh(own.g),
        ],
        axis=1,
    )
    # the column of the shortest wavelength shows all of the emission
    wave, first = case.wavelength_nm, own.source[:, 0]
    photons = first * wave / wave[0] / max(float(own.step_nm @ first), FLOOR)
    emitted = (own.step_nm[:, None] * own.source).sum(axis=0)
    return State(host, model.excitation.fit(emitted, FLOOR), model.emission.fit(photons, FLOOR))


def _information(
    case: Case, *, white: bool = False, backgrounds: slice = BOTH
) -> DesignInformation:
    from estimators.translucent_fluorescence import FluorescentForward, design_information

    visit = (white_visit if white else led_visit)(case, fast_light(case), seed=1)
    part = visit.reduced(slice(None), slice(None), backgrounds)
    model = FluorescentForward.of(case.bench, case.samples, case.wavelength_nm)
    return design_information(model, true_state(case, model), part)


def design_table(case: Case | None = None) -> dict[str, DesignInformation]:
    """Information of designs by name, from the bench's white lamp to three thicknesses.

    Args:
        case: with the LEDs of the full design; None: the default one.
    """
    full = case or Case()
    one_white = full.white_leds[:1]

    def narrow(*centres: float) -> Case:
        return replace(full, led_centre_nm=centres, white_leds=one_white)

    return {
        "bench's white lamp alone": _information(full, white=True),
        "two white LEDs": _information(replace(full, led_centre_nm=())),
        "405 nm and one white LED": _information(narrow(405.0)),
        "455 nm and one white LED": _information(narrow(455.0)),
        "405, 455, 505 nm and one white LED": _information(narrow(405.0, 455.0, 505.0)),
        "all eight": _information(full),
        "all eight, white background only": _information(full, backgrounds=WHITE_ONLY),
        "all eight, black background only": _information(full, backgrounds=BLACK_ONLY),
        "all eight, 0.4 mm only": _information(replace(full, samples=full.samples[:1])),
        "all eight, 1 mm only": _information(replace(full, samples=full.samples[1:])),
        "all eight, 0.4, 1 and 2 mm": _information(
            replace(full, samples=(*full.samples, THICKEST))
        ),
    }
