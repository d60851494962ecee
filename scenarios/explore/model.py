"""One picture from the positions of the sliders: spectra, captures, colours, uncertainty.

All with the fast engine (`estimators.Forward`) and arrays of fixed shapes, so that nothing is
compiled between two moves of a slider. No browser is needed for any of it.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import RLock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenarios.explore.contours import Plane, grid_model, height_of, parts_grid, plane_of
from scenarios.explore.moves import move_cosine, move_scale, move_share
from scenarios.explore.noise import covariance_of, light_of
from scenarios.explore.sliders import Settings
from scenarios.explore.source import MOST_WAVELENGTHS, Source, Spectrum
from scenarios.explore.uncertainty import Uncertainty, uncertainty_of
from twin.errors import InputError
from twin.spectra import FloatArray, SpectralTable

if TYPE_CHECKING:
    from estimators.forward import Forward
    from scenarios.report.colour import Swatch

THICK_MM = 1e6
"""Through this no light gets at any extinction of the sliders."""
SAMPLES = 3
"""At least so many are computed, so that visits to one to three samples share a program."""
KEPT = 200
"""Engines and planes that are kept: going back to a position costs nothing."""
_Made = TypeVar("_Made")


@dataclass(frozen=True, eq=False)
class Picture:
    """What the page shows for one position of the sliders.

    Attributes:
        settings: that position.
        spectrum: the material, shape (W,) each.
        n, rho_black, rho_white: index and backgrounds, shape (W,).
        thickness_mm: of every sample [mm], shape (S,).
        captures: black, white and collimated relative intensities, shape (W, S, 3).
        thick: radiance factor of an opaque sample on this bench, shape (W,).
        sigma: standard errors of the captures, shape (W, S, 3).
        uncertainty: of albedo, sigma_t and g at every wavelength.
        swatches: over black, over white, thick; None where the wavelengths carry no colour.
    """

    settings: Settings
    spectrum: Spectrum
    n: FloatArray
    rho_black: FloatArray
    rho_white: FloatArray
    thickness_mm: FloatArray
    captures: FloatArray
    thick: FloatArray
    sigma: FloatArray
    uncertainty: Uncertainty
    swatches: tuple[Swatch, Swatch, Swatch] | None

    @property
    def point(self) -> tuple[float, float]:
        """I over black and I over white at the chosen wavelength and sample."""
        black, white, _ = self.captures[self.settings.wavelength, self.settings.sample]
        return float(black), float(white)


class Explorer:
    """Computes pictures of one source; safe to ask from several threads, one at a time.

    Args:
        source: what is explored.

    Raises:
        InputError: a bench that the fast engine cannot show, or an instrument without light.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self._light = light_of(source)
        self._lock = RLock()
        self._kept: OrderedDict[Any, Any] = OrderedDict()
        self._weights = _colour_weights(source.wavelength_nm)
        self.notes = (*source.notes, *self._light.notes)

    def first(self) -> Settings:
        """Where the page starts: the first material, near 550 nm, the first sample."""
        return self.at(next(iter(self.source.spectra)), self.source.middle, 0)

    def at(self, material: str, wavelength: int, sample: int) -> Settings:
        """Settings of a material as it is on the bench as it is described.

        Args:
            material: name of one of the source's spectra.
            wavelength: index of the wavelength.
            sample: index of the sample.

        Raises:
            InputError: a material that this source does not have.
        """
        source, own = self.source, self._spectrum(material)
        instrument = source.bench.instrument
        return Settings(
            material=material,
            wavelength=wavelength,
            sample=sample,
            albedo=float(own.albedo[wavelength]),
            sigma_t_per_mm=float(own.sigma_t_per_mm[wavelength]),
            g=float(own.g[wavelength]),
            thickness_mm=source.samples[sample].thickness_mm,
            n=float(source.n[wavelength]),
            rho_black=float(source.rho_black[wavelength]),
            rho_white=float(source.rho_white[wavelength]),
            acceptance_deg=source.bench.detector.acceptance_deg,
            averages=instrument.frames,
        )

    def warm(self) -> None:
        """Compile what slider moves need, so that the first is quick."""
        first = self.first()
        self.picture(first)
        self.plane(first)

    def picture(self, settings: Settings) -> Picture:
        """Everything that depends on the sliders but the contours.

        Raises:
            InputError: settings that this source does not have.
        """
        with self._lock:
            return self._picture(settings)

    def plane(self, settings: Settings) -> Plane:
        """The contours of the appearance map behind the point (see `contours.plane_of`)."""
        with self._lock:
            return self._plane(settings)

    def _picture(self, settings: Settings) -> Picture:
        source, index = self.source, settings.wavelength
        self._check(settings)
        base = self._spectrum(settings.material)
        spectrum = Spectrum(
            move_share(base.albedo, index, settings.albedo),
            move_scale(base.sigma_t_per_mm, index, settings.sigma_t_per_mm),
            move_cosine(base.g, index, settings.g),
        )
        n = 1.0 + move_scale(source.n - 1.0, index, settings.n - 1.0)
        rho_black = move_share(source.rho_black, index, settings.rho_black)
        rho_white = move_share(source.rho_white, index, settings.rho_white)
        own = source.samples[settings.sample].thickness_mm
        thickness = np.array([s.thickness_mm for s in source.samples]) * settings.thickness_mm / own
        forward = self._forward(n, thickness, settings.acceptance_deg)
        values, slopes = forward.forward_and_jacobian(
            forward.parameters(
                *(padded(each) for each in (spectrum.albedo, spectrum.sigma_t_per_mm, spectrum.g)),
                rho_black=padded(rho_black), rho_white=padded(rho_white),
            )
        )  # fmt: skip
        shape = (slice(len(n)), slice(len(thickness)))
        every, slope = np.asarray(values)[: len(n)], np.asarray(slopes)[shape]
        captures, thick = every[:, : len(thickness)], every[:, -1, 0]
        covariance = covariance_of(
            captures, self._light, source, settings.averages, drift=settings.drift
        )
        engine = forward.relative_error[: len(thickness)] * np.abs(captures)
        covariance += engine[..., None] ** 2 * np.eye(3)
        used = slice(None) if settings.all_samples else slice(settings.sample, settings.sample + 1)
        return Picture(
            settings, spectrum, n, rho_black, rho_white, thickness, captures, thick,
            np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)),
            uncertainty_of(
                spectrum, captures[:, used], slope[:, used], covariance[:, used]
            ),
            self._swatches(captures[:, settings.sample], thick),
        )  # fmt: skip

    def _check(self, settings: Settings) -> None:
        source = self.source
        for name, value, count in (
            ("wavelength", settings.wavelength, len(source.wavelength_nm)),
            ("sample", settings.sample, len(source.samples)),
        ):
            if not 0 <= value < count:
                raise InputError(f"number {value}", f"0 to {count - 1}", place=name)

    def _spectrum(self, material: str) -> Spectrum:
        spectra = self.source.spectra
        if material not in spectra:
            raise InputError(f'the material "{material}"', ", ".join(spectra), place="material")
        return spectra[material]

    def _forward(self, n: FloatArray, thickness: FloatArray, acceptance_deg: float) -> Forward:
        """The engine of the samples and, as one more, of an opaque one.

        Always as many samples, so that sources share the compiled program. What the thickness
        changes besides the optical thickness is put in here; another index or aperture is another
        engine, and the last ones are kept.
        """
        engine: Forward = self._remember(
            ("engine", n.tobytes(), acceptance_deg), lambda: self._engine(n, acceptance_deg)
        )
        depth = np.pad(thickness, (0, self._count - len(thickness)), mode="edge")
        planes = np.zeros((len(depth) + 1, 3))
        # the opaque sample's top lies where the white was, whatever its thickness
        planes[:-1, 0] = [np.log(self._height(float(each))) for each in depth]
        depth = np.append(depth, THICK_MM)
        captures = engine.captures
        geometry = captures.constants.geometry._replace(planes=planes, thickness_mm=depth)
        captures = replace(
            captures,
            constants=captures.constants._replace(geometry=geometry),
            nominal=captures.nominal._replace(thickness_mm=depth),
        )
        return replace(engine, captures=captures)

    def _engine(self, n: FloatArray, acceptance_deg: float) -> Forward:
        from estimators import BenchModel
        from estimators.forward import Forward
        from twin.bench import Sample

        source = self.source
        detector = source.bench.detector.model_copy(update={"acceptance_deg": acceptance_deg})
        bench = source.bench.model_copy(update={"detector": detector})
        index = float(n[0]) if len(n) == 1 else SpectralTable(
            wavelength_nm=tuple(source.wavelength_nm.tolist()), value=tuple(n.tolist())
        )  # fmt: skip
        samples = [
            Sample(name=str(number), thickness_mm=1.0, n=index) for number in range(self._count + 1)
        ]
        return Forward.of(BenchModel.of(bench, samples, padded(source.wavelength_nm)))

    @property
    def _count(self) -> int:
        return max(len(self.source.samples), SAMPLES)

    def _height(self, thickness_mm: float) -> float:
        return self._remember(
            ("height", thickness_mm), lambda: height_of(self.source.bench, thickness_mm)
        )

    def _plane(self, settings: Settings) -> Plane:
        bench = self.source.bench
        at = source_wavelength(self.source, settings)
        key = (at, settings.n)
        model = self._remember(("model", *key), lambda: grid_model(bench, at, settings.n))
        grid = self._remember(("grid", *key, settings.g), lambda: parts_grid(model, settings.g))
        height = self._height(settings.thickness_mm)
        return plane_of(grid, height, settings.thickness_mm, settings.rho_black, settings.rho_white)

    def _remember(self, key: Any, make: Callable[[], _Made]) -> _Made:
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            self._kept[key] = make()
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        found: _Made = self._kept[key]
        return found

    def _swatches(self, captures: FloatArray, thick: FloatArray) -> Any:
        if self._weights is None:
            return None
        weights = self._weights
        return tuple(
            weights.swatch(weights.xyz(self.source.wavelength_nm, np.asarray(values)))
            for values in (captures[:, 0], captures[:, 1], thick)
        )


def padded(values: FloatArray) -> FloatArray:
    """Values (W,) followed by repetitions of the last one, `MOST_WAVELENGTHS` in all."""
    return np.pad(values, (0, MOST_WAVELENGTHS - len(values)), mode="edge")


def source_wavelength(source: Source, settings: Settings) -> float:
    """The chosen wavelength [nm]."""
    return float(source.wavelength_nm[settings.wavelength])


def _colour_weights(wavelength_nm: FloatArray) -> Any:
    """Tristimulus weights under D65 (`scenarios.predict.colour`), or None without a colour."""
    from scenarios.predict.colour import Weights
    from scenarios.report.colour import NEEDED_NM, VISIBLE_NM, WIDEST_HOLE_NM

    visible: NDArray[np.bool_] = (wavelength_nm >= VISIBLE_NM[0]) & (wavelength_nm <= VISIBLE_NM[1])
    usable = wavelength_nm[visible]
    if (
        usable.size < 4
        or usable[0] > NEEDED_NM[0]
        or usable[-1] < NEEDED_NM[1]
        or np.diff(usable).max() > WIDEST_HOLE_NM
    ):
        return None
    return Weights(float(usable[0]), float(usable[-1]), "D65")
