"""From readings with integrating spheres to the problem that is diagnosed.

diagnosis = diagnose_spheres(["il_B.rxt"], dilutions=True)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.problem import Candidate, Channel, Problem
from diagnosis.refit import fit
from diagnosis.screening import cannot_show
from diagnosis.sphere_effects import CATALOGUE, SphereEffect, candidates, without
from diagnosis.sphere_layout import check, data, labels, numbers, places, start, twin_models
from diagnosis.sphere_noise import SphereNoise, noise_of
from diagnosis.sphere_twin import G_LIMIT, READINGS, SphereTwin
from diagnosis.suspects import judgeable
from twin.effects import LeftOut
from twin.measurement.rxt import SphereVisit, read_rxt
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from diagnosis.verdict import Diagnosis
    from estimators.sphere import SphereSettings

Say = Callable[[str], None]


def _silent(text: str) -> None:
    """Say nothing."""


@dataclass(frozen=True, eq=False)
class SphereCase:
    """A problem and what it was made of.

    Attributes:
        problem: what `diagnose` takes.
        twin: predicts the readings.
        noise: what was taken for noise.
        left_out: entries of the catalogue that could not be used, and why.
        reasons: what was masked and assumed.
    """

    problem: Problem
    twin: SphereTwin
    noise: SphereNoise
    left_out: tuple[tuple[str, str], ...]
    reasons: tuple[str, ...]


def sphere_case(
    visits: SphereVisit | Sequence[SphereVisit],
    *,
    settings: SphereSettings | None = None,
    dilutions: bool = False,
    concentration: Sequence[float] | None = None,
    fillings: Sequence[int] | None = None,
    diluent: bool = False,
    noise: SphereNoise | None = None,
    effects: Sequence[SphereEffect] = CATALOGUE,
    say: Say = _silent,
) -> SphereCase:
    """The problem of sphere measurements of one material, its signatures at the no-effect fit.

    Args:
        visits: one file or several. Without `dilutions` every visit is one sample with the same
            wavelengths, and all have the same material (other thicknesses, say).
        settings: of the sphere estimator: method, held g, incidence, lost light.
        dilutions: the rows of the one visit (or the visits) are dilutions of one stock: they
            share albedo and g, and each has its own sigma_t.
        concentration: of the dilutions, any unit; then they share one sigma_t per concentration
            and equal ones are repeats.
        fillings: equal numbers for rows that repeat one dilution where concentrations are not
            known; the noise is found from them.
        diluent: search an absorption that all dilutions share.
        noise: None finds it from repeats, else takes what the estimator assumes.
        effects: the catalogue.
        say: told of what a person should know.

    Raises:
        InputError: the visits do not belong together, or cannot be used.
    """
    from estimators.sphere import SphereSettings

    settings = settings or SphereSettings()
    visits = (visits,) if isinstance(visits, SphereVisit) else tuple(visits)
    rows_are_samples = dilutions and len(visits) == 1
    place = places(visits, rows_are_samples)
    count = place[0].shape[1]
    check(visits, dilutions, concentration, fillings, count)
    captures = tuple(c for c in READINGS if all(c in v.measured for v in visits))
    value, valid = data(visits, place, captures)
    held = None
    if "M_U" not in captures or settings.hold_g:
        g = visits[0].g if settings.g is None else np.full(visits[0].rows, settings.g)
        g = np.clip(np.where(np.isfinite(g), g, 0.0), -G_LIMIT, G_LIMIT)
        held = g[:1] if rows_are_samples else g
    own_names, repeats = labels(visits, rows_are_samples, concentration)
    shared = None
    if concentration is not None:
        shared = np.asarray(concentration, dtype=float) / float(np.max(concentration))
    elif not dilutions:
        shared = np.ones(count)
    names = own_names if shared is not None else tuple(
        f"{name}, filling {r + 1}" if max(repeats) else name
        for name, r in zip(own_names, repeats, strict=True)
    )  # fmt: skip
    used, unused = _applicable(effects, dilutions, diluent, concentration is not None)
    twin = SphereTwin(
        twin_models(visits, settings), place[0], place[1], names, captures, shared, held,
        diluent, used, min(settings.log2_paths, 14), settings.seed,
    )  # fmt: skip
    sample_names = tuple(dict.fromkeys(names))
    channels = tuple(
        Channel(c, name, repeats[s] if shared is not None else 0)
        for s, name in enumerate(names)
        for c in captures
    )
    wavelength = visits[0].wavelength_nm
    if rows_are_samples:
        wavelength = wavelength[:1]
    reasons = [text for visit in visits for text in visit.reasons]
    if not np.isfinite(wavelength).all():
        wavelength = np.arange(1.0, len(wavelength) + 1.0)
        reasons.append("the file states no wavelength: rows are counted instead")
    ascending = np.argsort(wavelength, kind="stable")
    if not np.array_equal(ascending, np.arange(len(wavelength))):
        wavelength, value, valid = wavelength[ascending], value[ascending], valid[ascending]
        held = None if held is None else held[ascending]
        twin = replace(twin, visit=place[0][ascending], row=place[1][ascending], held_g=held)
    parameters = len(twin.names)
    thickness = {} if dilutions else {
        name: float(visits[v].thickness_mm[r])
        for name, v, r in zip(names, place[0][0], place[1][0], strict=True)
    }  # fmt: skip
    found = candidates(used, captures, sample_names if concentration is not None else ())
    shape = value.shape
    bare = Problem(
        wavelength_nm=wavelength,
        channels=channels,
        value=np.where(valid, value, 0.0),
        valid=valid,
        independent=np.broadcast_to(np.eye(shape[1]), (*shape, shape[1])),
        common=np.empty((0, *shape)),
        material=np.zeros((shape[0], parameters)),
        forward=twin.forward,
        jacobian=twin.jacobian,
        signatures=np.zeros((len(found), *shape)),
        candidates=found,
        thickness_mm=thickness,
        material_names=twin.names,
    )
    if cannot_show(bare):
        # nothing can be seen: no noise, no fit and no response would change that
        taken = noise or SphereNoise()
        return SphereCase(bare, twin, taken, _pairs(unused), (*reasons, taken.reason))
    bare = replace(bare, material=start(visits, settings, twin))
    if fillings is None and concentration is not None:
        fillings = numbers(concentration)
    bare, taken = noise_of(bare, twin, noise, fillings)
    reasons.append(taken.reason)
    fitted = fit(replace(bare, candidates=(), signatures=bare.signatures[:0])).material

    def signature(each: Candidate) -> FloatArray:
        step = 0.1 * each.prior_scale[0]
        back = 0.0 if each.sign[0] else -step
        ahead, behind = (
            twin.forward(fitted, {each.name: np.array([value])}) for value in (step, back)
        )
        return np.asarray((ahead - behind) / (step - back))[None]

    tested = judgeable(found, signature, shape, left_out=unused, say=say)
    problem = replace(
        bare, material=fitted, candidates=tested.suspects, signatures=tested.signatures
    )
    return SphereCase(problem, twin, taken, _pairs(tested.left_out), tuple(reasons))


def _applicable(
    effects: Sequence[SphereEffect], dilutions: bool, diluent: bool, concentration: bool
) -> tuple[tuple[SphereEffect, ...], tuple[LeftOut, ...]]:
    """Effects that these data can have, and why they cannot have the others."""
    why = {}
    if not dilutions:
        why["diluent"] = "only dilutions share a diluent"
    elif diluent:
        why["diluent"] = "it is searched together with the material"
    if not concentration:
        why["concentration"] = "no concentrations are given"
    return (
        tuple(effect for effect in effects if effect.field not in why),
        tuple(LeftOut(each.name, why[each.field]) for each in effects if each.field in why),
    )


def _pairs(left_out: Sequence[LeftOut]) -> tuple[tuple[str, str], ...]:
    return tuple((each.name, each.reason) for each in left_out)


def diagnose_spheres(
    paths: Sequence[str | Path] | str | Path,
    *,
    settings: SphereSettings | None = None,
    dilutions: bool = False,
    concentration: Sequence[float] | None = None,
    diluent: bool = False,
    leave_out: Sequence[str] = (),
    seed: int = 0,
    say: Say = _silent,
) -> Diagnosis:
    """Diagnose `.rxt` files; see `sphere_case` for the arguments.

    Args:
        paths: one file or several.
        settings: of the sphere estimator.
        dilutions: the rows of one file (or the files) are dilutions of one stock.
        concentration: of the dilutions.
        diluent: search an absorption that all dilutions share.
        leave_out: effects that the catalogue shall not have.
        seed: of the simulations.
        say: told what was assumed and left out.

    Raises:
        InputError: a file or an argument that cannot be used.
    """
    from diagnosis.diagnose import diagnose

    files = [paths] if isinstance(paths, (str, Path)) else list(paths)
    case = sphere_case(
        [read_rxt(path) for path in files], settings=settings, dilutions=dilutions,
        concentration=concentration, diluent=diluent, effects=without(leave_out), say=say,
    )  # fmt: skip
    for reason in case.reasons:
        say(reason)
    return diagnose(case.problem, seed=seed)
