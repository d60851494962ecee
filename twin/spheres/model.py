"""The forward model of a visit with integrating spheres: material in, readings out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.spectra import FloatArray
from twin.spheres.lost import LossGeometry, LossTable, LostLight
from twin.spheres.readings import Method, SphereSetup

if TYPE_CHECKING:
    from twin.measurement.rxt import SphereVisit
    from twin.spheres.program import Inputs


@dataclass(frozen=True, eq=False)
class SphereModel:
    """Everything about a visit but the material and the readings (W rows).

    Attributes:
        setup: spheres and method.
        incidence_deg: angle of the beam to the normal [degrees].
        thickness_mm, n, slide_n, slide_depth, wall_r, wall_t, standard_r, standard_t: (W,).
        loss_geometry: what decides the lost light; None: nothing is lost.
        air, trapped: streams of adding-doubling.
    """

    setup: SphereSetup
    incidence_deg: float
    thickness_mm: FloatArray
    n: FloatArray
    slide_n: FloatArray
    slide_depth: FloatArray
    wall_r: FloatArray
    wall_t: FloatArray
    standard_r: FloatArray
    standard_t: FloatArray
    loss_geometry: LossGeometry | None = None
    air: int = 16
    trapped: int = 16

    @classmethod
    def of(
        cls,
        visit: SphereVisit,
        *,
        method: Method = "substitution",
        incidence_deg: float | None = None,
        unscattered_in_r: float | None = None,
        unscattered_in_t: float | None = None,
        lost_light: bool = True,
        air: int = 16,
        trapped: int = 16,
    ) -> SphereModel:
        """The model of a visit; what the file does not say is given here.

        Args:
            visit: what the file says.
            method: "substitution" or "comparison" (dual beam); no file says which.
            incidence_deg: angle of the beam [degrees]; None takes the file's column, else 0.
            unscattered_in_r: collected share of the unscattered reflected light; None takes
                the file's column, else 1.
            unscattered_in_t: the same of the transmitted light.
            lost_light: whether to take off the light that misses the ports (never without
                spheres).
            air: streams of adding-doubling that leave the slab.
            trapped: streams that total reflection keeps inside.

        Raises:
            InputError: a method or angle that cannot be, or dimensions that change from row to
                row where lost light is wanted.
        """
        angle = visit.incidence_deg if incidence_deg is None else incidence_deg
        if not 0.0 <= angle < 90.0:
            raise InputError(f"{angle:g} degrees", "0 to less than 90 degrees", place="incidence")
        setup = SphereSetup(
            visit.spheres,
            visit.reflection_sphere,
            visit.transmission_sphere,
            method,
            visit.unscattered_in_r if unscattered_in_r is None else unscattered_in_r,
            visit.unscattered_in_t if unscattered_in_t is None else unscattered_in_t,
        )
        geometry = None
        if lost_light and setup.loses_light:
            geometry = _loss_geometry(visit, setup, angle)
        return cls(
            setup, float(angle), visit.thickness_mm, visit.n, visit.slide_n, visit.slide_depth,
            visit.wall_r, visit.wall_t, visit.standard_r, visit.standard_t, geometry, air, trapped,
        )  # fmt: skip

    @property
    def rows(self) -> int:
        """Number of rows W."""
        return len(self.n)

    def loss_table(
        self, g: FloatArray | None, *, log2_paths: int = 16, seed: int = 0
    ) -> LossTable | None:
        """Table of lost light for known anisotropy factors (or None); None: nothing is lost."""
        if self.loss_geometry is None:
            return None
        return LossTable.of(self.loss_geometry, g, self.n, log2_paths=log2_paths, seed=seed)

    def readings(
        self, albedo: FloatArray, sigma_t_per_mm: FloatArray, g: FloatArray, table: LossTable | None
    ) -> tuple[FloatArray, FloatArray]:
        """(M_R, M_T, M_U) of one material per row, and slopes, shapes (W, 3) and (W, 3, 3)."""
        parameters = np.stack(np.broadcast_arrays(albedo, sigma_t_per_mm, g), axis=-1)
        rows = np.arange(self.rows)
        lost = table.at(parameters, self.n) if table is not None else None
        readings, slopes, _ = self.at_rows(parameters, rows, lost)
        return readings, slopes

    def at_rows(
        self, parameters: FloatArray, rows: NDArray[np.int_], lost: LostLight | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Readings (P, 3), slopes (P, 3, 3) and figures (P, 6) of P materials (P, 3) in rows."""
        from twin.spheres.program import readings_and_slopes

        return readings_and_slopes(
            self.setup,
            float(np.cos(np.radians(self.incidence_deg))),
            np.asarray(parameters, dtype=np.float64),
            self._inputs(rows, lost),
            air=self.air,
            trapped=self.trapped,
        )

    def _inputs(self, rows: NDArray[np.int_], lost: LostLight | None) -> Inputs:
        from twin.spheres.program import Inputs

        count = len(rows)
        share = np.zeros((count, 4)) if lost is None else lost.share
        slope = np.zeros((count, 4, 3)) if lost is None else lost.slope
        return Inputs(
            self.thickness_mm[rows], self.n[rows], self.slide_n[rows], self.slide_depth[rows],
            self.wall_r[rows], self.wall_t[rows], self.standard_r[rows], self.standard_t[rows],
            share, slope,
        )  # fmt: skip


def _loss_geometry(visit: SphereVisit, setup: SphereSetup, angle: float) -> LossGeometry:
    """The one geometry of a visit."""
    lengths = {
        "d": visit.thickness_mm,
        "D": visit.slide_thickness_mm,
        "N": visit.slide_n,
        "B": visit.beam_mm,
    }
    for column, values in lengths.items():
        if np.ptp(values) > 0.0:
            raise InputError(
                f"column {column} with {values.min():g} to {values.max():g}",
                "one value, since light that misses the ports is found for one geometry",
                file=visit.file,
                place=f"column {column}",
                remedy="Split the file, or switch lost light off.",
            )
    if setup.reflection is None or setup.transmission is None:
        raise InputError("no spheres", "both spheres", file=visit.file, place="spheres")
    return LossGeometry(
        float(visit.thickness_mm[0]),
        float(visit.slide_n[0]),
        float(visit.slide_thickness_mm[0]),
        float(visit.beam_mm[0]),
        setup.reflection.sample_port_mm,
        setup.transmission.sample_port_mm,
        angle,
        diffuse=setup.method == "substitution",
    )
