"""The fast engine as estimators use it: adding-doubling with the finite bench's correction.

`Forward.of(model)` is built once per bench; `forward` and `forward_and_jacobian` then cost
milliseconds for a whole spectrum. This is the only way in which estimators evaluate a bench, so
that what is corrected here is corrected for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from estimators.protocol import BenchModel
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from jax import Array

    from twin.adding_doubling import CapturesModel, Constants, Form, Parameters
    from twin.appearance import AppearanceMap, FiniteFactors

DARKEST = 1e-4
"""Captures below this are too dark to tell the engine's relative error."""


@dataclass(frozen=True, eq=False)
class Forward:
    """Captures of S samples at W wavelengths as a function of the material and of nuisances.

    Attributes:
        captures: the plane-parallel engine.
        relative_error: relative standard error of the engine itself, shape (S, 3); it is common
            to neighbouring wavelengths, so averaging over them does not lessen it.
        factors: what the finite bench changes, one for each sample, or none.
    """

    captures: CapturesModel
    relative_error: FloatArray
    factors: tuple[FiniteFactors, ...] = ()

    @property
    def corrected(self) -> bool:
        """Whether appearance maps supplied what the finite bench changes."""
        return bool(self.factors)

    @classmethod
    def of(cls, model: BenchModel) -> Forward:
        """The engine of a bench; its finite extent is known where `model.maps` know it.

        Raises:
            InputError: the model knows no bench, or one that a plane-parallel stack cannot show
                (a scattering cover, samples of several refractive indices).
        """
        import jax

        from twin.adding_doubling import STATED_BOUND, captures_model
        from twin.appearance import AppearanceMap, FiniteFactors

        if model.bench is None or not model.samples:
            raise InputError(
                "a bench model without a bench or without samples",
                "the bench and its samples",
                place="model",
                remedy="Make it by BenchModel.of(bench, samples, wavelength_nm).",
            )
        captures = captures_model(model.bench, model.samples, model.wavelength_nm)
        error = np.full((len(model.samples), 3), STATED_BOUND)
        maps = [
            each
            for each in model.maps
            if isinstance(each, AppearanceMap) and each.factors is not None
        ]
        if not maps or len(maps) < len(model.samples):
            return cls(captures, error)
        return cls(
            captures,
            np.hypot(error, map_errors(maps, model)),
            tuple(jax.tree.map(jax.numpy.asarray, FiniteFactors.of(each)) for each in maps),
        )

    @property
    def nominal(self) -> Parameters:
        """Parameters as the bench describes them; albedo, sigma_t and g are NaN."""
        return self.captures.nominal

    def parameters(
        self, albedo: ArrayLike, sigma_t_per_mm: ArrayLike, g: ArrayLike, **nuisances: ArrayLike
    ) -> Parameters:
        """Parameters in full shape; nuisances (n, thickness_mm, rho_black, rho_white) nominal."""
        return self.captures.parameters(albedo, sigma_t_per_mm, g, **nuisances)

    def forward(self, parameters: Parameters) -> Array:
        """Relative intensities, shape (W, S, 3): black, white, collimated; pure JAX."""
        if not self.factors:
            return self.captures.forward(parameters)
        captures = self.captures
        found = _programs()[0](parameters, captures.constants, self.factors, captures.form)
        return cast("Array", found)

    def forward_and_jacobian(
        self,
        parameters: Parameters,
        names: tuple[str, ...] = ("albedo", "sigma_t_per_mm", "g"),
    ) -> tuple[Array, Array]:
        """`forward`, and its derivatives by the named parameters, shape (W, S, 3, names).

        A capture depends on its own wavelength and sample alone, so `thickness_mm` of shape (S,)
        and the others of shape (W,) are all differentiated at once.
        """
        if not self.factors:
            return self.captures.forward_and_jacobian(parameters, names)
        captures = self.captures
        found = _programs()[1](parameters, captures.constants, self.factors, captures.form, names)
        return cast("tuple[Array, Array]", found)


def captures_of(
    parameters: Parameters, constants: Constants, factors: tuple[FiniteFactors, ...], form: Form
) -> Array:
    """Captures, (W, S, 3): what programs are built from; benches of one form share them.

    Args:
        parameters: of W wavelengths.
        constants: of `Forward.captures`.
        factors: of `Forward.factors`.
        form: of `Forward.captures`.
    """
    from twin.adding_doubling import parts_of
    from twin.appearance import finite_captures

    parts = parts_of(parameters, constants, form)
    if not factors:
        rho = (parameters.rho_black[:, None], parameters.rho_white[:, None])
        return parts.captures(*rho)
    return cast("Array", finite_captures(parts, factors, parameters))


def captures_and_slopes(
    parameters: Parameters,
    constants: Constants,
    factors: tuple[FiniteFactors, ...],
    form: Form,
    names: tuple[str, ...],
) -> tuple[Array, Array]:
    """`captures_of`, and the derivatives by the named parameters, (W, S, 3, names)."""
    from twin.adding_doubling import value_and_slopes

    return value_and_slopes(
        lambda moved: captures_of(moved, constants, factors, form), parameters, names
    )


@lru_cache(maxsize=1)
def _programs() -> tuple[Any, Any]:
    """The compiled programs: captures, and captures with slopes; shared by all benches."""
    import jax

    return (
        jax.jit(captures_of, static_argnames=("form",)),
        jax.jit(captures_and_slopes, static_argnames=("form", "names")),
    )


def map_errors(maps: Sequence[AppearanceMap], model: BenchModel) -> FloatArray:
    """Median relative standard error of every map's captures, shape (S, 3)."""
    middle = len(model.wavelength_nm) // 2
    rows = []
    for own in maps:
        value = own.intensities(float(model.rho_black[middle]), float(model.rho_white[middle]))
        error = np.stack([own.black_se, own.white_se, own.collimated_se], axis=-1)
        lit = value > DARKEST
        relative = np.where(lit, error / np.where(lit, value, 1.0), np.nan)
        rows.append(np.nanmedian(relative.reshape(-1, 3), axis=0))
    return np.array(rows)
