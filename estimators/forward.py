"""The fast engine as estimators use it: adding-doubling with the finite bench's correction.

`Forward.of(model)` is built once per bench; `forward` and `forward_and_jacobian` then cost
milliseconds for a whole spectrum. This is the only way in which estimators evaluate a bench, so
that what is corrected here is corrected for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from estimators.protocol import BenchModel
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from jax import Array

    from twin.adding_doubling import CapturesModel, Parameters


@dataclass(frozen=True, eq=False)
class Forward:
    """Captures of S samples at W wavelengths as a function of the material and of nuisances.

    Attributes:
        captures: the plane-parallel engine.
        relative_error: relative standard error of the engine itself, shape (S, 3); it is common
            to neighbouring wavelengths, so averaging over them does not lessen it.
    """

    captures: CapturesModel
    relative_error: FloatArray

    @classmethod
    def of(cls, model: BenchModel) -> Forward:
        """The engine of a bench.

        Raises:
            InputError: the model knows no bench, or one that a plane-parallel stack cannot show
                (a scattering cover, samples of several refractive indices).
        """
        from twin.adding_doubling import STATED_BOUND, captures_model

        if model.bench is None or not model.samples:
            raise InputError(
                "a bench model without a bench or without samples",
                "the bench and its samples",
                place="model",
                remedy="Make it by BenchModel.of(bench, samples, wavelength_nm).",
            )
        captures = captures_model(model.bench, model.samples, model.wavelength_nm)
        error = np.full((len(model.samples), 3), STATED_BOUND)
        return cls(captures, error)

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
        return self.captures.forward(parameters)

    def forward_and_jacobian(
        self,
        parameters: Parameters,
        names: tuple[str, ...] = ("albedo", "sigma_t_per_mm", "g"),
    ) -> tuple[Array, Array]:
        """`forward`, and its derivatives by the named parameters, shape (W, S, 3, names).

        A capture depends on its own wavelength and sample alone, so `thickness_mm` of shape (S,)
        and the others of shape (W,) are all differentiated at once.
        """
        return self.captures.forward_and_jacobian(parameters, names)
