"""An integrating sphere: its ports as shares of its surface, and its gain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from twin.errors import InputError


def cap_share(port_mm: float, diameter_mm: float) -> float:
    """Share of a sphere's surface that the cap behind a round port takes.

    A plane cuts off a cap of area pi D h with h = (D - sqrt(D^2 - d^2)) / 2 out of pi D^2.
    (IAD uses the flat disc, (d / 2D)^2, which is smaller by 1.6 % for d = D / 4.)
    """
    return (1.0 - math.sqrt(1.0 - (port_mm / diameter_mm) ** 2)) / 2.0


@dataclass(frozen=True)
class IntegratingSphere:
    """A sphere with three round ports (lengths [mm]).

    Attributes:
        diameter_mm: inner diameter.
        sample_port_mm: diameter of the port that the sample closes.
        third_port_mm: of the entrance port of a reflectance measurement, or of the port
            opposite to the sample of a transmittance measurement; 0: there is none.
        detector_port_mm: of the detector's port.
        wall_reflectance: diffuse reflectance of the wall.
        detector_reflectance: diffuse reflectance of what fills the detector's port.
        baffle: a baffle keeps light from going directly between sample and detector.

    Raises:
        InputError: a port that does not fit, ports that leave no wall, or a reflectance
            outside 0 to 1.
    """

    diameter_mm: float
    sample_port_mm: float
    third_port_mm: float = 0.0
    detector_port_mm: float = 0.0
    wall_reflectance: float = 0.98
    detector_reflectance: float = 0.0
    baffle: bool = True

    def __post_init__(self) -> None:
        if not (math.isfinite(self.diameter_mm) and self.diameter_mm > 0.0):
            raise InputError(
                f"a sphere of {self.diameter_mm:g} mm", "a diameter above 0 mm", place="sphere"
            )
        for name in ("sample_port_mm", "third_port_mm", "detector_port_mm"):
            value = getattr(self, name)
            if not 0.0 <= value < self.diameter_mm:
                raise InputError(
                    f"a port of {value:g} mm",
                    f"0 mm to less than the sphere's {self.diameter_mm:g} mm",
                    place=name,
                )
        for name in ("wall_reflectance", "detector_reflectance"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"a reflectance of {value:g}", "0 to 1", place=name)
        if self.wall_share <= 0.0:
            raise InputError(
                "ports that take the whole sphere", "ports that leave some wall", place="ports"
            )

    @property
    def sample_share(self) -> float:
        """Share of the surface behind the sample port."""
        return cap_share(self.sample_port_mm, self.diameter_mm)

    @property
    def third_share(self) -> float:
        """Share of the surface behind the third port."""
        return cap_share(self.third_port_mm, self.diameter_mm)

    @property
    def detector_share(self) -> float:
        """Share of the surface behind the detector's port."""
        return cap_share(self.detector_port_mm, self.diameter_mm)

    @property
    def wall_share(self) -> float:
        """Share of the surface that is wall."""
        return 1.0 - self.sample_share - self.third_share - self.detector_share

    def first_bounce(self, wall: Any, third: Any = 0.0) -> Any:
        """Share of the light leaving the sample that becomes even illumination of the sphere.

        With a baffle that light meets the wall or the third port first,
        r_first = (1 - a_t) r_w + a_t r_t; without one it is as good as even at once.
        """
        if not self.baffle:
            return 1.0
        return (1.0 - self.third_share) * wall + self.third_share * third

    def gain(self, sample: Any, wall: Any, third: Any = 0.0) -> Any:
        """Even illumination of the sphere per diffuse power put in.

        X = S + X (a_w r_w + a_t r_t + r_first (a_s r_s + a_d r_d)), so G = X / S is

            G = 1 / (1 - a_w r_w - a_t r_t - r_first (a_s r_s + a_d r_d)),

        where r_first = 1 without a baffle. Sources: Pickering et al. (1993), Applied Optics
        32, 399, eq. (5); Prahl (2011), "Everything I think you should know about inverse
        adding-doubling", sec. 5. The sums are power balances, exact for a closed third port
        (IAD spreads the third port over the wall: different at order a_t a_s).

        Args:
            sample: diffuse reflectance of what closes the sample port; anything that
                broadcasts, arrays of JAX included.
            wall: reflectance of the wall, likewise.
            third: reflectance of what closes the third port, likewise.
        """
        first = self.first_bounce(wall, third)
        kept = self.wall_share * wall + self.third_share * third
        kept = kept + first * (
            self.sample_share * sample + self.detector_share * self.detector_reflectance
        )
        return 1.0 / (1.0 - kept)
