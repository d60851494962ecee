"""The translucent bench as an immutable, validated description (lengths in mm).

Frame: z points from the sample to the detector; the top of the sample stack is z = 0, the
stack fills z = 0 down to -H, the background plane lies at z = -H - gap. Every default is the
bench of Iser et al. 2022, section 4.1 ("Affordable Spectral Measurements of Translucent
Materials", ACM TOG 41(6)).
"""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, field_validator

from twin.instrument.spec import Instrument, Spectrometer
from twin.spectra import Part, Spectral


class Panel(Part):
    """A Lambertian rectangle of uniform radiance that faces the origin."""

    width_mm: float = Field(default=141.0, gt=0)
    """Extent [mm] in the plane of incidence (perpendicular to y)."""
    length_mm: float = Field(default=283.0, gt=0)
    """Extent [mm] along y for azimuth 0 and 180."""
    distance_mm: float = Field(default=300.0, gt=0)
    """Distance [mm] of the centre from the origin."""
    polar_deg: float = Field(default=45.0, ge=0, lt=85)
    """Angle [deg] between the direction to the centre and +z."""
    azimuth_deg: float = 0.0
    """Azimuth [deg] of the centre, from +x towards +y."""

    @property
    def centre_mm(self) -> tuple[float, float, float]:
        """Centre (x, y, z) [mm]."""
        polar, azimuth = math.radians(self.polar_deg), math.radians(self.azimuth_deg)
        return (
            self.distance_mm * math.sin(polar) * math.cos(azimuth),
            self.distance_mm * math.sin(polar) * math.sin(azimuth),
            self.distance_mm * math.cos(polar),
        )


class Beam(Part):
    """A collimated beam from below, along +z, centred on the axis."""

    diameter_mm: float = Field(default=1.0, gt=0)
    divergence_deg: float = Field(default=0.0, ge=0, lt=45)
    """Half-angle [deg] of the uniform cone of directions."""
    spectrum: Spectral = "led_warm_white"
    """Lamp: relative spectral power per nm."""


class Medium(Part):
    """A homogeneous participating medium with a Henyey-Greenstein phase function."""

    albedo: Spectral
    """Single-scattering albedo, 0 to 1."""
    sigma_t_per_mm: Spectral
    """Extinction coefficient [1/mm], at least 0."""
    g: Spectral = 0.0
    """Anisotropy factor, inside -1 to 1."""


class Layer(Part):
    """One plane-parallel layer of the stack; without a medium it is clear."""

    thickness_mm: float = Field(gt=0)
    n: Spectral = 1.5
    """Refractive index: a number, a table, or a name such as "glass_d263"."""
    medium: Medium | None = None


class Background(Part):
    """A Lambertian reflector; outside its outline nothing comes back."""

    reflectance: Spectral
    """Reflectance, 0 to 1."""
    shape: Literal["disc", "rectangle"] = "disc"
    size_mm: tuple[float, float] = (25.4, 25.4)
    """Extent [mm] along x and y; a disc has its diameter twice."""

    @field_validator("size_mm")
    @classmethod
    def _positive(cls, value: tuple[float, float]) -> tuple[float, float]:
        if min(value) <= 0:
            raise ValueError(f"found {value}; expected two lengths above 0 mm")
        return value


class Backgrounds(Part):
    """The two backgrounds and the air gap between them and the stack."""

    gap_mm: float = Field(default=0.5, ge=0)
    """Thickness [mm] of the air between the stack and the background."""
    black: Background = Background(
        reflectance="flocked_paper", shape="rectangle", size_mm=(40.0, 40.0)
    )
    white: Background = Background(reflectance="spectralon")


class Detector(Part):
    """Collects what crosses a disc on z = 0, upward, within a cone around +z."""

    spot_panels_mm: float = Field(default=2.0, gt=0)
    """Diameter [mm] of the disc when the panels are lit."""
    spot_beam_mm: float = Field(default=4.0, gt=0)
    """Diameter [mm] of the disc when the beam is lit."""
    acceptance_deg: float = Field(default=1.0, gt=0, lt=60)
    """Half-angle [deg] of the cone."""


COVER_GLASS = Layer(thickness_mm=0.15, n=1.52)


class Bench(Part):
    """Everything but the sample: lights, covers, backgrounds, detector, instrument."""

    panels: tuple[Panel, ...] = (Panel(), Panel(azimuth_deg=180.0))
    panel_spectrum: Spectral = "led_cool_white"
    """Lamp of the panels: relative spectral power per nm."""
    beam: Beam = Beam()
    covers_above: tuple[Layer, ...] = (COVER_GLASS,)
    """Clear or scattering layers on top of the sample, top to bottom; () for a bare sample."""
    covers_below: tuple[Layer, ...] = (COVER_GLASS,)
    """Layers under the sample, top to bottom."""
    size_mm: tuple[float, float] | None = (40.0, 40.0)
    """Lateral extent [mm] of the stack along x and y; "unbounded" (None) for a plane layer."""
    background: Backgrounds = Backgrounds()
    detector: Detector = Detector()
    instrument: Instrument = Spectrometer()
    reference_plane_mm: float | None = None
    """z [mm] of the white in the white reference; None: the background plane of each sample."""

    @field_validator("panels")
    @classmethod
    def _some_panels(cls, value: tuple[Panel, ...]) -> tuple[Panel, ...]:
        if not 1 <= len(value) <= 8:
            raise ValueError(f"found {len(value)} panels; expected 1 to 8")
        return value

    @field_validator("size_mm", mode="before")
    @classmethod
    def _unbounded(cls, value: object) -> object:
        return None if value == "unbounded" else value

    @field_validator("size_mm")
    @classmethod
    def _positive(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and min(value) <= 0:
            raise ValueError(f"found {value}; expected two lengths above 0 mm")
        return value


class Sample(Part):
    """One piece of material as it is put on the bench."""

    name: str = Field(min_length=1)
    thickness_mm: float = Field(gt=0)
    n: Spectral = 1.5
    """Refractive index of the sample's medium."""
    material: str | Medium | None = None
    """The true medium (library name or numbers) of a simulated sample; None when unknown."""


def stack_of(bench: Bench, sample: Sample, medium: Medium | None) -> tuple[Layer, ...]:
    """The whole stack, top to bottom: covers above, the sample's layer, covers below."""
    layer = Layer(thickness_mm=sample.thickness_mm, n=sample.n, medium=medium)
    return (*bench.covers_above, layer, *bench.covers_below)
