"""Measurement in, material with uncertainty out.

model = BenchModel.of(bench, samples, intensities.wavelength_nm, maps)
result = estimator("lut", model).estimate(intensities)
"""

from __future__ import annotations

from estimators.beer import BeerEstimator, BeerSettings, beer_check
from estimators.export import read_netcdf, to_datatree, write_csv, write_netcdf
from estimators.lut import LutEstimator
from estimators.lut_settings import LutSettings
from estimators.protocol import BenchModel, Estimator
from estimators.registry import estimator, names
from estimators.result import CAPTURES, PARAMETERS, EstimateResult, Status

__all__ = [
    "CAPTURES",
    "PARAMETERS",
    "BeerEstimator",
    "BeerSettings",
    "BenchModel",
    "EstimateResult",
    "Estimator",
    "LutEstimator",
    "LutSettings",
    "Status",
    "beer_check",
    "estimator",
    "names",
    "read_netcdf",
    "to_datatree",
    "write_csv",
    "write_netcdf",
]
