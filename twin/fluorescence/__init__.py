"""Fluorescent materials: Donaldson matrices, illuminant sets, detectors, visits.

A `DonaldsonMatrix` (energy units, [emission, excitation]) and a `FluorescenceSystem` (illuminants
and sensitivities on its bins) give noiseless captures. A `FluorescenceSetup` describes lights,
detector and white; `simulate_fluorescence` takes the shots of a visit through the instruments of
`twin.instrument`, and `corrected` turns a `FluorescenceVisit` into the `FluorescenceData` that
estimators get. The bounded MESE, in JAX, is `twin.fluorescence.mese`: import it by name, so that
everything else starts without JAX.
"""

from __future__ import annotations

from twin.fluorescence.bfc import parse_bfc, read_bfc
from twin.fluorescence.correction import corrected
from twin.fluorescence.donaldson import GRID_NM, DonaldsonMatrix, from_photons, to_photons
from twin.fluorescence.fitoolbox import fitoolbox_max_relative_error
from twin.fluorescence.fluorophores import (
    FLUOROPHORES,
    MATERIALS,
    Band,
    Fluorophore,
    dyed,
    example,
    fluorophore,
    product,
)
from twin.fluorescence.illuminants import (
    Edge,
    Filtered,
    Illuminant,
    Lamp,
    Led,
    Monochromatic,
    Sampled,
    binned_light,
    outside_share,
)
from twin.fluorescence.mixture import (
    Gaussian,
    MixtureModel,
    from_mixture,
    gaussian_mixture,
    read_matrix_csv,
    read_mixture,
    write_matrix_csv,
    write_mixture,
)
from twin.fluorescence.sets import PRICE_USD, as7341, light_set, spectrometer
from twin.fluorescence.setup import (
    SETUPS,
    FluorescenceProtocol,
    FluorescenceSetup,
    detector_response,
    named_setup,
    nominal_system,
)
from twin.fluorescence.simulation import simulate_fluorescence
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem, plain_data
from twin.fluorescence.visit import FluorescenceShot, FluorescenceVisit
from twin.fluorescence.visit_file import is_fluorescence_visit, read_visit, write_visit
from twin.fluorescence.visit_folder import read_visit_folder, write_counts_csv

__all__ = [
    "FLUOROPHORES",
    "GRID_NM",
    "MATERIALS",
    "PRICE_USD",
    "SETUPS",
    "Band",
    "DonaldsonMatrix",
    "Edge",
    "Filtered",
    "FluorescenceData",
    "FluorescenceProtocol",
    "FluorescenceSetup",
    "FluorescenceShot",
    "FluorescenceSystem",
    "FluorescenceVisit",
    "Fluorophore",
    "Gaussian",
    "Illuminant",
    "Lamp",
    "Led",
    "MixtureModel",
    "Monochromatic",
    "Sampled",
    "as7341",
    "binned_light",
    "corrected",
    "detector_response",
    "dyed",
    "example",
    "fitoolbox_max_relative_error",
    "fluorophore",
    "from_mixture",
    "from_photons",
    "gaussian_mixture",
    "is_fluorescence_visit",
    "light_set",
    "named_setup",
    "nominal_system",
    "outside_share",
    "parse_bfc",
    "plain_data",
    "product",
    "read_bfc",
    "read_matrix_csv",
    "read_mixture",
    "read_visit",
    "read_visit_folder",
    "simulate_fluorescence",
    "spectrometer",
    "to_photons",
    "write_counts_csv",
    "write_matrix_csv",
    "write_mixture",
    "write_visit",
]
