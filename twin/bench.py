"""The translucent bench as an immutable, validated description (lengths in mm).

Frame: z points from the sample to the detector; the top of the sample stack is z = 0, the
stack fills z = 0 down to -H, the background plane lies at z = -H - gap. Every default is the
bench of Iser et al. 2022, section 4.1 ("Affordable Spectral Measurements of Translucent
Materials", ACM TOG 41(6)).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from twin.instrument.spec import Instrument, Spectrometer
from twin.spectra import Part, Spectral


class Growing(Part):
    """A part with effects that are off by default: switched off, they are not written down.

    What describes a bench without them, and every key made of that, stays the same.
    """

    _EFFECTS: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _switched_on(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = handler(self)
        for name in self._EFFECTS:
            if getattr(self, name) == type(self).model_fields[name].default:
                written.pop(name, None)
        return written


class Panel(Growing):
    """A Lambertian rectangle that faces the origin, of uniform radiance but for `gradient`."""

    _EFFECTS = ("level", "gradient")

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
    level: float = Field(default=1.0, gt=0, le=100)
    """Radiance at the centre, relative to the other panels."""
    gradient: float = Field(default=0.0, ge=-1, le=1)
    """Relative change of the radiance from the centre to the lower edge (that at the larger polar
    angle), linear along the width; the upper edge changes by as much the other way."""

    @property
    def centre_mm(self) -> tuple[float, float, float]:
        """Centre (x, y, z) [mm]."""
        polar, azimuth = math.radians(self.polar_deg), math.radians(self.azimuth_deg)
        return (
            self.distance_mm * math.sin(polar) * math.cos(azimuth),
            self.distance_mm * math.sin(polar) * math.sin(azimuth),
            self.distance_mm * math.cos(polar),
        )


class Beam(Growing):
    """A collimated beam from below, along +z, centred on the axis."""

    _EFFECTS = ("tilt_deg",)

    diameter_mm: float = Field(default=1.0, gt=0)
    divergence_deg: float = Field(default=0.0, ge=0, lt=45)
    """Half-angle [deg] of the uniform cone of directions."""
    tilt_deg: float = Field(default=0.0, gt=-45, lt=45)
    """Angle [deg] from +z towards +x, about the middle of the stack's lower face."""
    spectrum: Spectral = "led_warm_white"
    """Lamp: relative spectral power per nm."""

    @property
    def straight(self) -> bool:
        """Whether all its light goes along the axis."""
        return self.divergence_deg == 0.0 and self.tilt_deg == 0.0


class Medium(Growing):
    """A homogeneous participating medium with a Henyey-Greenstein phase function.

    With a second lobe the phase function is (1 - f) HG(g1) + f HG(second_g), f = second_share,
    where g1 = (g - f second_g) / (1 - f) keeps the mean cosine at g (two-term
    Henyey-Greenstein: Kattawar 1975).
    """

    _EFFECTS = ("second_share", "second_g")

    albedo: Spectral
    """Single-scattering albedo, 0 to 1."""
    sigma_t_per_mm: Spectral
    """Extinction coefficient [1/mm], at least 0."""
    g: Spectral = 0.0
    """Anisotropy factor, inside -1 to 1: the mean cosine, second lobe included."""
    second_share: float = Field(default=0.0, ge=0, lt=1)
    """Share of the scattered light in the second lobe; 0 for one lobe."""
    second_g: float = Field(default=-0.5, ge=-0.95, le=0.95)
    """Anisotropy factor of the second lobe; negative for a backward one."""


class Layer(Part):
    """One plane-parallel layer of the stack; without a medium it is clear."""

    thickness_mm: float = Field(gt=0)
    n: Spectral = 1.5
    """Refractive index: a number, a table, or a name such as "glass_d263"."""
    medium: Medium | None = None


class Background(Growing):
    """A Lambertian reflector but for `gloss`; outside its outline nothing comes back."""

    _EFFECTS = ("gloss",)

    reflectance: Spectral
    """Reflectance, 0 to 1."""
    shape: Literal["disc", "rectangle"] = "disc"
    size_mm: tuple[float, float] = (25.4, 25.4)
    """Extent [mm] along x and y; a disc has its diameter twice."""
    gloss: float = Field(default=0.0, ge=0, le=1)
    """Share of the reflectance that is mirror-like; the detector, which looks along the normal,
    sees the rest alone when nothing lies in between."""

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

    @property
    def glossy(self) -> bool:
        """Whether one of the backgrounds reflects a share like a mirror."""
        return self.black.gloss > 0.0 or self.white.gloss > 0.0


class Detector(Part):
    """Collects what crosses a disc on z = 0, upward, within a cone around +z."""

    spot_panels_mm: float = Field(default=2.0, gt=0)
    """Diameter [mm] of the disc when the panels are lit."""
    spot_beam_mm: float = Field(default=4.0, gt=0)
    """Diameter [mm] of the disc when the beam is lit."""
    acceptance_deg: float = Field(default=1.0, gt=0, lt=60)
    """Half-angle [deg] of the cone."""


class AcceptedEffect(Part):
    """An effect of `twin.effects` that a diagnosis found and a person accepted."""

    name: str = Field(min_length=1)
    """Name of the candidate, such as "thickness[0.4 mm]"."""
    values: tuple[float, ...]
    """Fitted value of every parameter of the effect, in its units."""
    uncertainty: tuple[float, ...] = ()
    """Standard errors of the values; () when unknown."""


COVER_GLASS = Layer(thickness_mm=0.15, n=1.52)


class Bench(Growing):
    """Everything but the sample: lights, covers, backgrounds, detector, instrument."""

    _EFFECTS = ("offset_mm", "effects")

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
    offset_mm: tuple[float, float] = (0.0, 0.0)
    """Where the stack's middle lies off the axis [mm], along x and y."""
    background: Backgrounds = Backgrounds()
    detector: Detector = Detector()
    instrument: Instrument = Spectrometer()
    reference_plane_mm: float | None = None
    """z [mm] of the white in the white reference; None: the background plane of each sample."""
    effects: tuple[AcceptedEffect, ...] = ()
    """Effects that are no field of the bench; `twin.effects.World.nominal` applies them."""

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

    @model_validator(mode="after")
    def _on_the_axis(self) -> Bench:
        if self.size_mm is None or self.offset_mm == (0.0, 0.0):
            return self
        spot = max(
            self.detector.spot_panels_mm, self.detector.spot_beam_mm, self.beam.diameter_mm
        )  # fmt: skip
        room = [(size - spot) / 2 for size in self.size_mm]
        if any(abs(shift) > most for shift, most in zip(self.offset_mm, room, strict=True)):
            raise ValueError(
                f"found a stack {self.offset_mm} mm off the axis; expected no more than"
                f" ({room[0]:g}, {room[1]:g}) mm, so that it still covers the detector's spots"
            )
        return self


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
