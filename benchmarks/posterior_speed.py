"""Time of the posterior of 31 wavelengths, beside a plain emcee loop.

`posterior_31_s` is warm wall-clock time of `PosteriorEstimator.estimate` with the stated
effective sample size at every wavelength; `posterior_31_cpu_s` the processor time of the same
run (the larger of the two says more on a busy machine). `posterior_speed_ratio` is time per
effective sample of a plain emcee loop over ours: default stretch moves, one Python call of the
likelihood per parameter vector and wavelength, which evaluates the same fast engine at one
wavelength. The plain loop runs a few hundred steps at one wavelength; its time per effective
sample is extrapolated from its time per step and the autocorrelation time of the same sampler on
a three-dimensional normal distribution, which flatters it where the posterior is not normal.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from twin.spectra import FloatArray

WAVELENGTHS = 31
NOISE, FLOOR = 0.003, 2e-4
EFFECTIVE = 1000


def run(quick: bool) -> dict[str, float]:
    """Keys `posterior_31_s`, `posterior_31_cpu_s`, `posterior_speed_ratio`, `min_ess`."""
    from estimators.posterior import PosteriorEstimator, PosteriorSettings
    from estimators.protocol import BenchModel
    from twin.bench import Bench, Sample

    bench = Bench()
    samples = tuple(Sample(name=f"{h:g} mm", thickness_mm=h) for h in (0.3, 0.6, 1.2))
    wavelength = np.linspace(400.0, 700.0, WAVELENGTHS)
    model = BenchModel.of(bench, samples, wavelength)
    share = np.linspace(0.0, 1.0, WAVELENGTHS)
    material = np.stack([0.95 - 0.4 * share, 3.0 - 2.0 * share, 0.8 - 0.4 * share], axis=-1)
    intensities = _simulated(model, material)
    effective = 250 if quick else EFFECTIVE
    estimator = PosteriorEstimator(model, PosteriorSettings(effective_samples=effective))
    estimator.estimate(intensities)
    begin, begin_cpu = time.perf_counter(), time.process_time()
    result = estimator.estimate(intensities)
    seconds, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
    sizes = result.statistics["effective_sample_size"]
    ours = seconds / float(sizes.sum())
    plain = _plain(model, intensities, result.parameters, 40 if quick else 150)
    return {
        "posterior_31_s": seconds,
        "posterior_31_cpu_s": cpu,
        "posterior_speed_ratio": plain / ours,
        "min_ess": float(sizes.min()),
        "converged": float(result.statistics["converged"].mean()),
        "max_emulator_error": float(result.statistics["emulator_error"].max()),
        "plain_s_per_effective_sample": plain,
        "s_per_effective_sample": ours,
    }


def _simulated(model, material: FloatArray):  # type: ignore[no-untyped-def]
    from estimators.forward import Forward
    from twin.measurement.relative import RelativeIntensities

    forward = Forward.of(model)
    exact = np.asarray(forward.forward(forward.parameters(*material.T)))
    sigma = np.maximum(NOISE * exact, FLOOR)
    random = np.random.Generator(np.random.Philox(key=[31, 1]))
    value = exact + sigma * random.standard_normal(exact.shape)
    count, size = len(material), exact[0].size
    covariance = sigma.reshape(count, size, 1) ** 2 * np.eye(size)
    return RelativeIntensities(
        sample_names=model.sample_names,
        thickness_mm=np.array([sample.thickness_mm for sample in model.samples]),
        wavelength_nm=model.wavelength_nm,
        value=value.transpose(1, 2, 0),
        covariance=covariance,
        valid=np.ones(exact.transpose(1, 2, 0).shape, dtype=bool),
        reasons=(),
        repeats=1,
    )


def _plain(model, intensities, estimate: FloatArray, steps: int) -> float:  # type: ignore[no-untyped-def]
    """Seconds per effective sample of a plain emcee loop at the middle wavelength."""
    import emcee

    from estimators.forward import Forward
    from estimators.posterior_sampler import autocorrelation_time

    middle = model.wavelength_nm.size // 2
    one = replace(
        model,
        wavelength_nm=model.wavelength_nm[[middle]],
        n=model.n[:, [middle]],
        rho_black=model.rho_black[[middle]],
        rho_white=model.rho_white[[middle]],
    )
    forward = Forward.of(one)
    value = np.asarray(intensities.value)[..., middle]
    sigma = np.sqrt(np.diagonal(intensities.covariance[middle])).reshape(value.shape)

    def log_probability(theta: FloatArray) -> float:
        albedo, sigma_t, g = theta
        if not (0.0 < albedo < 1.0 and 0.01 < sigma_t < 100.0 and -0.2 < g < 0.99):
            return -np.inf
        captures = np.asarray(forward.forward(forward.parameters(albedo, sigma_t, g)))[0]
        return float(-0.5 * np.sum(((captures - value) / sigma) ** 2) - np.log(sigma_t))

    random = np.random.Generator(np.random.Philox(key=[31, 2]))
    walkers = 32
    first = estimate[middle] * (1.0 + 1e-3 * random.standard_normal((walkers, 3)))
    sampler = emcee.EnsembleSampler(walkers, 3, log_probability)
    sampler.run_mcmc(first, 3)
    begin = time.perf_counter()
    sampler.run_mcmc(None, steps)
    per_step = (time.perf_counter() - begin) / steps
    # the stretch move on a normal of three dimensions, which this posterior nearly is
    normal = emcee.EnsembleSampler(
        walkers, 3, lambda x: -0.5 * np.sum(x**2, axis=1), vectorize=True
    )
    normal.run_mcmc(random.standard_normal((walkers, 3)), 4000)
    tau = autocorrelation_time(np.asarray(normal.get_chain()))
    return per_step * tau / walkers
