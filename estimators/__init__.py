"""Measurement in, material with uncertainty out.

model = BenchModel.of(bench, samples, intensities.wavelength_nm, maps)
result = estimator("least-squares", model).estimate(intensities)
"""

from __future__ import annotations

from estimators.beer import BeerEstimator, BeerSettings
from estimators.beer_law import beer_check
from estimators.budget import InputUncertainty, UncertaintyBudget, uncertainty_budget
from estimators.export import read_netcdf, to_datatree, write_csv, write_netcdf
from estimators.forward import Forward
from estimators.kubelka_munk import KubelkaMunkEstimator, KubelkaMunkSettings
from estimators.least_squares import LeastSquaresEstimator, LeastSquaresSettings
from estimators.lut import LutEstimator
from estimators.lut_settings import LutSettings
from estimators.optimisers import (
    AdamEstimator,
    AdamSettings,
    NelderMeadEstimator,
    PowellEstimator,
    SearchSettings,
)
from estimators.posterior import PosteriorEstimator
from estimators.posterior_export import to_inference_data
from estimators.posterior_settings import PosteriorSettings
from estimators.protocol import BenchModel, Estimator
from estimators.registry import estimator, names
from estimators.result import CAPTURES, PARAMETERS, EstimateResult, Status
from estimators.sphere import SphereEstimator, SphereSettings
from estimators.sphere_result import SphereEstimate

__all__ = [
    "CAPTURES",
    "PARAMETERS",
    "AdamEstimator",
    "AdamSettings",
    "BeerEstimator",
    "BeerSettings",
    "BenchModel",
    "EstimateResult",
    "Estimator",
    "Forward",
    "InputUncertainty",
    "KubelkaMunkEstimator",
    "KubelkaMunkSettings",
    "LeastSquaresEstimator",
    "LeastSquaresSettings",
    "LutEstimator",
    "LutSettings",
    "NelderMeadEstimator",
    "PosteriorEstimator",
    "PosteriorSettings",
    "PowellEstimator",
    "SearchSettings",
    "SphereEstimate",
    "SphereEstimator",
    "SphereSettings",
    "Status",
    "UncertaintyBudget",
    "beer_check",
    "estimator",
    "names",
    "read_netcdf",
    "to_datatree",
    "to_inference_data",
    "uncertainty_budget",
    "write_csv",
    "write_netcdf",
]
