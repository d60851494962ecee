"""A bench for tests of the core: the real fast engine with hand-made effects and covariance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from diagnosis import Candidate, Channel, Problem, Smoothness, fit
from diagnosis.reduction import Reduction
from estimators.forward import Forward
from estimators.protocol import BenchModel
from twin.bench import Bench, Sample

CAPTURES = ("black", "white", "collimated")


@dataclass
class Toy:
    """Material in logit(albedo), ln(sigma_t), atanh(g); effects act on parameters or captures."""

    thickness_mm: tuple[float, ...] = (0.5, 1.0, 2.0)
    wavelengths: int = 31
    repeats: int = 3
    noise: float = 0.004
    drift: float = 0.002
    engines: dict[bytes, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.wl = np.linspace(400.0, 700.0, self.wavelengths)
        self.names = tuple(f"s{i}" for i in range(len(self.thickness_mm)))
        samples = [
            Sample(name=name, thickness_mm=t)
            for name, t in zip(self.names, self.thickness_mm, strict=True)
        ]
        self.engine = Forward.of(BenchModel.of(Bench(), samples, self.wl))
        x = (self.wl - 550.0) / 150.0
        self.tilt = x
        self.lamp = 0.15 + np.exp(-(((self.wl - 450) / 20) ** 2)) + np.exp(-(x**2) / 0.4)
        self.channels = tuple(
            Channel(c, s, r) for r in range(self.repeats) for s in self.names for c in CAPTURES
        )
        panel = [Candidate("thickness", name, ("thickness",), ("mm",), (0.03 * t,), (0,))
                 for name, t in zip(self.names, self.thickness_mm, strict=True)]  # fmt: skip
        self.candidates = (
            *panel,
            Candidate("index", "", ("n",), ("1",), (0.02,), (0,)),
            Candidate("black level", "", ("rho",), ("1",), (0.01,), (0,)),
            Candidate("black red", "", ("rho",), ("1",), (0.03,), (1,)),
            Candidate("white ageing", "", ("loss",), ("1",), (0.03,), (1,)),
            Candidate("acceptance", "", ("share",), ("1",), (0.2,), (1,)),
            Candidate("dark offset", "", ("offset",), ("1",), (0.002,), (0,)),
            Candidate("stray light", "", ("share",), ("1",), (0.005,), (1,)),
            Candidate("panel level", "", ("level",), ("1",), (0.02,), (0,)),
            Candidate("panel tilt", "", ("tilt",), ("1",), (0.02,), (0,)),
            Candidate("beam level", "", ("level",), ("1",), (0.03,), (0,)),
            Candidate("ambient", "", ("share",), ("1",), (0.005,), (1,)),
            Candidate("gain step", "", ("step",), ("1",), (0.02,), (0,)),
            Candidate("roughness", "", ("haze",), ("1",), (0.05,), (1,)),
            Candidate("drift of two", "", ("level", "tilt"), ("1", "1"), (0.01, 0.01), (0, 0)),
        )

    def material(self, seed: int) -> np.ndarray:
        u = np.random.Generator(np.random.Philox(key=[seed, 1])).uniform(size=9)
        x = self.tilt
        bump = np.exp(-(((x - 2 * u[0] + 1) / (0.2 + 0.5 * u[1])) ** 2))
        albedo = 0.93 + 0.06 * u[2] - (0.02 + 0.08 * u[3]) * bump
        sigma = (1.0 + 1.5 * u[4]) * (1.0 - 0.3 * u[5] * x)
        g = 0.3 + 0.5 * u[6] + 0.03 * u[7] * x
        return np.stack([np.log(albedo / (1 - albedo)), np.log(sigma), np.arctanh(g)], axis=1)

    def values(self, effects, name):
        for key, value in effects.items():
            if key == name:
                return np.asarray(value, dtype=float)
        return np.zeros(2)

    def _parameters(self, material, effects):
        v = {k: np.asarray(x, dtype=float) for k, x in effects.items()}
        get = lambda name: float(v[name][0]) if name in v else 0.0  # noqa: E731
        thickness = np.array(self.thickness_mm) + [get(f"thickness[{n}]") for n in self.names]
        nominal = self.engine.nominal
        bowl = 1.0 - get("white ageing") * ((700 - self.wl) / 300) ** 2
        red = 1.0 / (1.0 + np.exp(-(self.wl - 640.0) / 15.0))
        rho = np.asarray(nominal.rho_black) + get("black level") + get("black red") * red
        return self.engine.parameters(
            1 / (1 + np.exp(-material[:, 0])),
            np.exp(material[:, 1]),
            np.tanh(material[:, 2]),
            n=np.asarray(nominal.n) + get("index"),
            thickness_mm=np.maximum(thickness, 1e-3),
            rho_black=np.clip(rho, 0.0, 1.0),
            rho_white=np.asarray(nominal.rho_white) * bowl,
        )

    def _after(self, light, material, effects):
        v = {k: np.asarray(x, dtype=float) for k, x in effects.items()}
        get = lambda name, i=0: float(v[name][i]) if name in v else 0.0  # noqa: E731
        light = np.array(light)
        tau = np.exp(material[:, 1])[:, None] * np.array(self.thickness_mm)
        light[:, :, 2] += get("acceptance") * 0.1 * tau * np.exp(-0.6 * tau)
        light[:, :, 2] += get("ambient") * light[:, :, 0]
        light[:, :, 2] *= 1 + get("beam level")
        light[:, :, 2] *= 1 - get("roughness") * (500 / self.wl[:, None]) ** 2
        mean = (light * self.lamp[:, None, None]).mean(axis=0)
        light += get("stray light") * (mean / self.lamp[:, None, None] - light)
        light[:, :, :2] *= 1 + get("panel level") + get("panel tilt") * self.tilt[:, None, None]
        light[:, :, :2] *= (
            1 + get("drift of two") + get("drift of two", 1) * self.tilt[:, None, None] ** 2
        )
        light[:, :, 1] *= 1 + get("gain step")
        return light + get("dark offset") / self.lamp[:, None, None]

    def forward(self, material, effects):
        p = self._parameters(material, effects)
        light = self._after(np.asarray(self.engine.forward(p)), material, effects)
        return np.tile(light.reshape(len(self.wl), -1), (1, self.repeats))

    def jacobian(self, material, effects):
        p = self._parameters(material, effects)
        light, slope = (np.asarray(a) for a in self.engine.forward_and_jacobian(p))
        albedo, g = p.albedo, np.asarray(p.g)
        chain = np.stack([albedo * (1 - albedo), np.asarray(p.sigma_t_per_mm), 1 - g**2], axis=1)
        base = self._after(light, material, effects)
        step = 1e-4
        columns = [
            (self._after(light + step * slope[..., k] * chain[:, k, None, None],
                         material + step * (np.arange(3) == k), effects) - base) / step
            for k in range(3)
        ]  # fmt: skip
        flat = np.stack(columns, axis=-1).reshape(len(self.wl), -1, 3)
        return np.tile(flat, (1, self.repeats, 1))

    def covariance(self, level):
        """Independent (W, M, M), common (K, W, M) at the expected data (W, M)."""
        size = (np.abs(level) + 0.01) * self.noise
        independent = np.einsum("wm,mn->wmn", size**2 / (self.lamp[:, None] + 0.3),
                                np.eye(size.shape[1]))  # fmt: skip
        modes = []
        for s in self.names:
            panel = np.array([c.sample == s and c.capture != "collimated" for c in self.channels])
            beam = np.array([c.sample == s and c.capture == "collimated" for c in self.channels])
            white = level * panel * 0.002  # the white reference of this sample, all repeats
            independent += white[:, :, None] * white[:, None, :]
            modes.append(self.drift * level * panel)
            modes.append(self.drift * level * panel * self.tilt[:, None])
            modes.append(self.drift * level * beam)
            for capture in CAPTURES:
                own = [c.sample == s and c.capture == capture for c in self.channels]
                modes.append(1e-3 * level * np.array(own))
        return independent, np.array(modes)

    def problem(self, seed, effects=None, candidates=None, extra=None, prior=False):
        """A measurement with effects at work, fitted without them, with its signatures."""
        generator = np.random.Generator(np.random.Philox(key=[seed, 2]))
        truth = self.material(seed)
        clean = self.forward(truth, effects or {})
        if extra is not None:
            clean = clean * (1 + extra(self))
        independent, common = self.covariance(clean)
        root = np.linalg.cholesky(independent)
        noise = np.einsum("wmn,wn->wm", root, generator.standard_normal(clean.shape))
        noise = noise + np.tensordot(generator.standard_normal(len(common)), common, 1)
        chosen = self.candidates if candidates is None else candidates
        columns = sum(c.size for c in chosen)
        smooth = Smoothness(60.0, (0.5, 0.3, 0.3), (0.01, 0.01, 0.01)) if prior else None
        problem = Problem(
            wavelength_nm=self.wl, channels=self.channels, value=clean + noise,
            valid=np.ones(clean.shape, dtype=bool), independent=independent, common=common,
            material=truth + 0.05, forward=self.forward, jacobian=self.jacobian,
            signatures=np.zeros((0, *clean.shape)), candidates=(),
            thickness_mm=dict(zip(self.names, self.thickness_mm, strict=True)),
            material_prior=smooth, material_names=("albedo", "sigma_t", "g"),
        )  # fmt: skip
        null = fit(problem)
        signatures = self.signatures(null.material, null.predicted, chosen)
        assert signatures.shape[0] == columns
        return replace(
            problem, material=null.material, signatures=signatures, candidates=tuple(chosen)
        )

    def signatures(self, material, base, chosen):
        rows = []
        for c in chosen:
            for i in range(c.size):
                step = 0.2 * c.prior_scale[i] * (c.sign[i] or 1)
                value = np.zeros(c.size)
                value[i] = step
                rows.append((self.forward(material, {c.name: value}) - base) / step)
        return np.array(rows)


@dataclass
class LinearToy:
    """The toy's bench linearised about one material: exact for the core, and fast."""

    toy: Toy
    seed: int = 7

    def __post_init__(self) -> None:
        base = self.toy.problem(self.seed)
        self.base = base
        self.level = self.toy.forward(base.material, {})
        self.slope = self.toy.jacobian(base.material, {})
        self.root = np.linalg.cholesky(base.independent)
        self.candidates = base.candidates

    def forward(self, material, effects):
        owned = dict(zip((c.name for c in self.base.candidates), self.base.columns, strict=True))
        data = self.level + np.einsum("wmp,wp->wm", self.slope, material - self.base.material)
        for name, value in effects.items():
            data = data + np.tensordot(
                np.asarray(value), self.base.signatures[list(owned[name])], 1
            )
        return data

    def noise(self, generator):
        white = generator.standard_normal(self.level.shape)
        return np.einsum("wmn,wn->wm", self.root, white) + np.tensordot(
            generator.standard_normal(len(self.base.common)), self.base.common, 1
        )

    def problem(self, seed, effects=None, **changes):
        generator = np.random.Generator(np.random.Philox(key=[seed, 3]))
        value = self.forward(self.base.material, effects or {}) + self.noise(generator)
        return replace(
            self.base, value=value, forward=self.forward,
            jacobian=lambda material, effects: self.slope, **changes,
        )  # fmt: skip

    def visible(self, name, sigmas, direction=1.0):
        """Values of an effect that move the reduced data by so many standard deviations."""
        index = [c.name for c in self.candidates].index(name)
        columns = Reduction.of(self.base, self.slope)(np.moveaxis(self.base.signatures, 0, -1))
        own = columns[:, list(self.base.columns[index])]
        way = np.array(self.candidates[index].prior_scale) * direction
        way = np.where(np.array(self.candidates[index].sign) < 0, -np.abs(way), way)
        return way * sigmas / np.linalg.norm(own @ way)
