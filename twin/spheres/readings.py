"""What a measurement with none, one or two integrating spheres reads from a sample.

Written with arithmetic alone, so that the same lines serve NumPy arrays and JAX tracers.
Sources: Pickering, Prahl, van Wieringen, Beek, Sterenborg and van Gemert (1993), "Double-
integrating-sphere system for measuring the optical properties of tissue", Applied Optics 32,
399; Prahl, van Gemert and Welch (1993), Applied Optics 32, 559; Prahl (2011), the manual of
inverse adding-doubling, sec. 5. docs/spheres.md derives every line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from twin.errors import InputError
from twin.spheres.sphere import IntegratingSphere

Method = Literal["substitution", "comparison"]


class SampleLight(NamedTuple):
    """What a sample does to light, the lost part still included (anything that broadcasts).

    Attributes:
        reflectance, transmittance: total, of the beam (UR1 and UT1 at its angle).
        diffuse_reflectance, diffuse_transmittance: of diffuse light (URU, UTU).
        unscattered_reflectance, unscattered_transmittance: unscattered parts of the beam.
    """

    reflectance: Any
    transmittance: Any
    diffuse_reflectance: Any
    diffuse_transmittance: Any
    unscattered_reflectance: Any
    unscattered_transmittance: Any


class Lost(NamedTuple):
    """Light that leaves the sample beside a port, per incident light: see `SampleLight`."""

    reflectance: Any = 0.0
    transmittance: Any = 0.0
    diffuse_reflectance: Any = 0.0
    diffuse_transmittance: Any = 0.0


class Surfaces(NamedTuple):
    """Reflectances around the sample (anything that broadcasts).

    Attributes:
        wall_r, wall_t: of the walls of the reflection and the transmission sphere.
        standard_r: of the reflectance standard.
        standard_t: of what closes the transmission sphere's third port.
    """

    wall_r: Any
    wall_t: Any
    standard_r: Any
    standard_t: Any = 1.0


@dataclass(frozen=True)
class SphereSetup:
    """How a measurement was made.

    Attributes:
        spheres: 0 (the readings are reflectances and transmittances already), 1 or 2.
        reflection, transmission: the spheres; None only where `spheres` is 0.
        method: "substitution" (sample and standard one after the other in the same port: the
            sphere's gain changes between them) or "comparison" (dual beam: both are in the
            sphere all the time, so the gain cancels).
        unscattered_in_r, unscattered_in_t: collected share of the unscattered light.
        beam_on_wall: share of the beam that misses the sample and meets the wall first.

    Raises:
        InputError: a number of spheres other than 0 to 2, a missing sphere, a share outside
            0 to 1, or a comparison with two spheres.
    """

    spheres: int
    reflection: IntegratingSphere | None = None
    transmission: IntegratingSphere | None = None
    method: Method = "substitution"
    unscattered_in_r: float = 1.0
    unscattered_in_t: float = 1.0
    beam_on_wall: float = 0.0

    def __post_init__(self) -> None:
        if self.spheres not in (0, 1, 2):
            raise InputError(f"{self.spheres} spheres", "0, 1 or 2", place="spheres")
        if self.spheres and (self.reflection is None or self.transmission is None):
            raise InputError(
                "a sphere without dimensions", "diameter and ports of both", place="spheres"
            )
        if self.method not in ("substitution", "comparison"):
            raise InputError(
                f"method {self.method!r}", '"substitution" or "comparison"', place="method"
            )
        if self.method == "comparison" and self.spheres == 2:
            raise InputError(
                "a comparison (dual beam) with two spheres", "one sphere", place="method"
            )
        for name in ("unscattered_in_r", "unscattered_in_t", "beam_on_wall"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{getattr(self, name):g}", "a share of 0 to 1", place=name)
        if self.method == "comparison" and self.beam_on_wall:
            raise InputError(
                "a dual beam of which a part misses the sample",
                "beam_on_wall 0: what such an instrument reports is not defined",
                place="beam_on_wall",
            )

    @property
    def loses_light(self) -> bool:
        """Whether light beside the ports is missing from the readings."""
        return self.spheres > 0


def sphere_readings(
    setup: SphereSetup, light: SampleLight, lost: Lost, surfaces: Surfaces
) -> tuple[Any, Any]:
    """M_R and M_T that the set-up reads; see the module for sources.

    Unscattered light is never lost beside a port: it lies inside the beam.

    Raises:
        InputError: a sphere without dimensions.
    """
    scattered_r = light.reflectance - light.unscattered_reflectance - lost.reflectance
    scattered_t = light.transmittance - light.unscattered_transmittance - lost.transmittance
    unscattered_r = setup.unscattered_in_r * light.unscattered_reflectance
    unscattered_t = setup.unscattered_in_t * light.unscattered_transmittance
    if setup.spheres == 0 or setup.method == "comparison":
        return scattered_r + unscattered_r, scattered_t + unscattered_t
    returned = light.diffuse_reflectance - lost.diffuse_reflectance
    through = light.diffuse_transmittance - lost.diffuse_transmittance
    sphere_r, sphere_t = setup.reflection, setup.transmission
    if sphere_r is None or sphere_t is None:
        raise InputError("a sphere without dimensions", "both spheres", place="spheres")
    wall_r, wall_t, miss = surfaces.wall_r, surfaces.wall_t, setup.beam_on_wall
    # a third port that does not exist is wall
    standard_t = surfaces.standard_t if sphere_t.third_share > 0.0 else wall_t
    # open, the third port lets the unscattered light out: shares between are mixtures
    opposite = setup.unscattered_in_t * standard_t if sphere_t.third_share > 0.0 else wall_t
    first_r = sphere_r.first_bounce(wall_r)
    first_t = sphere_t.first_bounce(wall_t, opposite)

    def source_r(scattered: Any, unscattered: Any) -> Any:
        """Even illumination put into the reflection sphere; specular light meets the wall."""
        hit = first_r * ((1.0 - miss) * scattered + miss * wall_r)
        return hit + (1.0 - miss) * wall_r * unscattered

    into_r = source_r(scattered_r, unscattered_r)
    into_t = (1.0 - miss) * (first_t * scattered_t + standard_t * unscattered_t)
    into_standard, into_nothing = source_r(surfaces.standard_r, 0.0), source_r(0.0, 0.0)
    if setup.spheres == 1:
        level = into_r * sphere_r.gain(returned, wall_r)
        standard = into_standard * sphere_r.gain(surfaces.standard_r, wall_r)
        nothing = into_nothing * sphere_r.gain(0.0, wall_r)
        reading_t = into_t * sphere_t.gain(returned, wall_t, opposite)
        full = (1.0 - miss) * standard_t * sphere_t.gain(0.0, wall_t, standard_t)
        empty = 0.0
    else:
        level, reading_t = exchange(
            setup, surfaces, returned, through, (into_r, into_t), (0.0, opposite)
        )
        standard, _ = exchange(
            setup, surfaces, surfaces.standard_r, 0.0, (into_standard, 0.0), (0.0, standard_t)
        )
        nothing, empty = exchange(setup, surfaces, 0.0, 0.0, (into_nothing, 0.0), (0.0, standard_t))
        # the empty port joins both spheres
        _, full = exchange(
            setup, surfaces, 0.0, 1.0,
            (into_nothing, (1.0 - miss) * standard_t), (0.0, standard_t),
        )  # fmt: skip
    reading_r = surfaces.standard_r * (level - nothing) / (standard - nothing)
    scale_t = surfaces.standard_t if sphere_t.third_share > 0.0 else 1.0
    return reading_r, scale_t * (reading_t - empty) / (full - empty)


def exchange(
    setup: SphereSetup,
    surfaces: Surfaces,
    returned: Any,
    through: Any,
    put_in: tuple[Any, Any],
    thirds: tuple[Any, Any],
) -> tuple[Any, Any]:
    """Even illumination of two spheres that share a sample.

    X1 = S1 + X1 k1 + X2 a_s' t r1 and X2 = S2 + X2 k2 + X1 a_s t r2 with 1 / (1 - k) = G give

        X1 = G1 (S1 + a_s' t r1 G2 S2) / (1 - a_s a_s' t^2 r1 r2 G1 G2)

    and the same with the spheres swapped (Pickering et al. 1993, eq. (15); IAD 3.16 writes
    the wall's area where its own text has the wall's reflectance).

    Args:
        setup: the two spheres.
        surfaces: reflectances of their walls.
        returned: diffuse reflectance of what is in the port.
        through: its diffuse transmittance.
        put_in: power put into each sphere, after its first bounce.
        thirds: reflectance at the third ports.

    Raises:
        InputError: a sphere without dimensions.
    """
    first, second = setup.reflection, setup.transmission
    if first is None or second is None:
        raise InputError("a sphere without dimensions", "both spheres", place="spheres")
    gain_1 = first.gain(returned, surfaces.wall_r, thirds[0])
    gain_2 = second.gain(returned, surfaces.wall_t, thirds[1])
    to_1 = second.sample_share * through * first.first_bounce(surfaces.wall_r, thirds[0])
    to_2 = first.sample_share * through * second.first_bounce(surfaces.wall_t, thirds[1])
    loop = 1.0 - to_1 * to_2 * gain_1 * gain_2
    level_1 = gain_1 * (put_in[0] + to_1 * gain_2 * put_in[1]) / loop
    level_2 = gain_2 * (put_in[1] + to_2 * gain_1 * put_in[0]) / loop
    return level_1, level_2
