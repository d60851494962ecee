"""Reflectances of the backgrounds that the seed's bench names.

None of the four is a published table. Their levels are those of Iser et al. 2022, section 4.2;
what else is known is in each note.
"""

from __future__ import annotations

from twin.materials.entry import Entry, tabulated

_ISER = 'Iser et al. 2022, section 4 ("Affordable Spectral Measurements", ACM TOG 41(6))'

REFLECTANCES: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        tabulated(
            "black_foil",
            _ISER,
            "350 0.05 1000 0.05",
            approximation=True,
            note="Black aluminium foil: about 5 %, taken as flat.",
        ),
        tabulated(
            "flocked_paper",
            _ISER,
            "350 0.02 650 0.02 680 0.03 720 0.06 780 0.16",
            approximation=True,
            note="About 2 %, rising substantially beyond 650 nm: that much is stated. The shape of"
            " the rise is ours.",
        ),
        tabulated(
            "ptfe",
            _ISER,
            "350 0.92 1000 0.92",
            approximation=True,
            note="A PTFE sheet: 92 %, taken as flat. It depends on thickness: 92.5 to 94.5 % at"
            " 450 nm for 5 to 10 mm (Ghosh et al. 2020).",
        ),
        tabulated(
            "spectralon",
            _ISER,
            "350 0.99 1000 0.99",
            approximation=True,
            note="The nominal 99 % of the diffuse reflectance standard, taken as flat. Calibrated"
            " panels lie within 0.003 of it: use your panel's certificate as a table.",
        ),
    )
}
"""Reflectances of backgrounds by name."""
