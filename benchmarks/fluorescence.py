"""Donaldson matrices from the four cheap set-ups: ours, the published fit, the published peer.

Materials: the six measured matrices of the data folder and all sums of two (fluorescence added,
the first one's diagonal kept: 30), cut to 400-700 nm; the noise below the diagonal and negative
cells, which cannot be lit, are set to 0 both in what is simulated and in what is compared with.
Captures come from simulated visits (`twin.fluorescence`: shot noise, drift of the lamps, darks,
calibration on a white), the same for all methods. No method was tuned on these matrices.

Keys (medians over materials; RMSE of the 465 cells below the diagonal, and of the diagonal):

- `rmse_ratio_fluo`, `rmse_ratio_diag`: ours over `gmm-adam`, ratio of the medians, median over
  set-ups; `..._by_setup` each; `..._sd` the standard error of the materials' choice (bootstrap over
  the materials, the same ones in all set-ups). `rmse_ratio_blasinski` (of the 465 cells) and
  `rmse_ratio_blasinski_diag`: over `blasinski` with cross-validated weights and bases of measured
  fluorophores and Munsell reflectances; `rmse_ratio_blasinski_best_by_setup` over the better of
  cross-validated and default weights (weights that predict left-out captures best are not always
  those of the best matrix).
- `rmse_fluo`, `rmse_diag`: by method and set-up; `nothing` predicts no fluorescence (it says
  nothing of the diagonal, and is in `rmse_fluo` alone), `donaldson-linear` is ours with the
  Gaussian background alone, `donaldson-quick` the same with a gain that is kept for all samples of
  a set-up.
- `de2000_ratio`: median over materials and wavelengths of CIEDE2000 under monochromatic light,
  ours over `gmm-adam`, median over set-ups.
- `coverage90`: share of the 465 cells inside the 90 % intervals (`FluorescenceResult.interval`),
  all materials and set-ups; `coverage90_quantiles` between the 0.05 and 0.95 quantiles, which is
  more where 0 is one of them; `coverage90_diag`. By the strength of the true cell:
  `coverage90_strong` (above 0.01), `coverage90_visible` (above 0.001), `coverage90_weak` (up to
  0.001, not 0). By the estimate, so that faults in opposite directions cannot cancel:
  `coverage90_determined`, `coverage90_undetermined` (flagged) and `coverage90_at_zero` (estimated
  as exactly 0), with `share_undetermined`, `share_at_zero`.
- `chi_square_reported`: of the reported matrix per capture, full covariance: median over materials
  of the worst set-up, and the largest of all.
- `seconds_per_material`: processor time of one estimate, warm, one at a time, the slowest set-up;
  `adam_seconds` of the published fit compiled as one program, `adam_loop_seconds` with its
  gradient compiled and its loop in Python, as published, both for the same captures.
  `speed_ratio_adam` is the first over ours, `speed_ratio_adam_loop` the second,
  `speed_ratio_adam_linear` the first over `donaldson-linear`. `seconds_per_material_quick`,
  `speed_ratio_adam_quick`, `rmse_ratio_fluo_quick_by_setup`: `donaldson-quick`, whose accuracy is
  another; its gain is made from the batch before, and from one sample it takes
  `quick_preparation_seconds`. `..._learned...` the same of `donaldson-learned`, whose network is
  trained once for a set-up in `learned_preparation_seconds`, on drawn materials.
- `fitoolbox_max_relative_error`: the forward model against fiToolbox's simulated set.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin.spectra import FloatArray

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "fluorescence"
SETUPS = ("l1-s1", "l1-s2", "l2-s1", "l2-s2")
GRID = np.arange(400.0, 701.0, 10.0)
VISIBLE, STRONG = 1e-3, 1e-2
CROSS_VALIDATED_ON = 6


def run(quick: bool) -> dict[str, Any]:
    """The keys above; only `skipped` where the data folder is not there."""
    path = DATA / "donaldson_bfc450.npz"
    if not path.exists():
        return {"skipped": "no measured matrices: ../shared/data/fluorescence is not there"}
    truths = materials(path)[:: 9 if quick else 1]
    bases = measured_bases()
    by_setup = {
        name: _compare(name, truths, bases, quick) for name in (SETUPS[1:2] if quick else SETUPS)
    }
    return {"materials": len(truths), **_summary(by_setup), **_forward()}


def measured(path: Path) -> list[Any]:
    """The measured matrices of a file, as `DonaldsonMatrix` on 400 to 700 nm."""
    from twin.fluorescence.donaldson import DonaldsonMatrix

    with np.load(path, allow_pickle=False) as file:
        out, into = file["wo"].astype(float), file["wi"].astype(float)
        names = [name for name in file.files if name not in ("wo", "wi")]
        return [
            DonaldsonMatrix(file[name], out, into, name=name, below="keep").on(GRID).physical()
            for name in names
        ]


def materials(path: Path) -> list[Any]:
    """Measured matrices and their sums, as `DonaldsonMatrix` on 400 to 700 nm."""
    single = measured(path)
    pairs = itertools.permutations(single, 2)
    return single + [one.with_fluorescence_of(other) for one, other in pairs]


def measured_bases() -> Any:
    """Bases of the published peer from measured fluorophores and Munsell reflectances."""
    from estimators.fluorescence.blasinski_bases import bases_of

    with np.load(DATA / "fluorophores" / "fluorophores_300-900_5nm.npz") as file:
        wavelength, into, out = file["wl"].astype(float), file["ex"], file["em"]
    with np.load(DATA / "reflectance" / "munsell_matt_1269_400-700_10nm.npz") as file:
        reflectance = np.asarray(file["refl"], dtype=np.float64)
    good = np.isfinite(into).all(axis=1) & np.isfinite(out).all(axis=1)
    excitation, emission = (
        np.stack([np.interp(GRID, wavelength, np.maximum(row, 0.0)) for row in each[good]])
        for each in (into, out)
    )
    seen = (excitation.max(axis=1) > 0.05) & (emission.max(axis=1) > 0.05)
    return bases_of(reflectance, excitation[seen], emission[seen])


def _compare(name: str, truths: Sequence[Any], bases: Any, quick: bool) -> dict[str, Any]:
    from estimators.fluorescence.adam import GmmAdamEstimator, GmmAdamSettings
    from estimators.fluorescence.blasinski import (
        BlasinskiEstimator,
        BlasinskiSettings,
        cross_validated,
    )
    from estimators.fluorescence.colour import monochromatic_difference
    from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
    from estimators.fluorescence.learned import DonaldsonLearnedEstimator, DonaldsonLearnedSettings
    from estimators.fluorescence.quick import DonaldsonQuickEstimator
    from scenarios.figures.fluorescence_runs import captures, errors

    data = captures(name, truths, seed=1)
    truth = np.array([each.matrix for each in truths])
    plain = BlasinskiSettings(bases=bases)
    tuned = cross_validated(data[:CROSS_VALIDATED_ON], plain, folds=2 if quick else 3)
    linear = DonaldsonEstimator(DonaldsonSettings(products=0, draws=0))
    ours, adam, swift = DonaldsonEstimator(), GmmAdamEstimator(), DonaldsonQuickEstimator()
    begin = time.process_time()
    swift.estimate_batch(data[:1])
    preparation = time.process_time() - begin
    swift = DonaldsonQuickEstimator()
    size: dict[str, Any] = {"materials": 5000, "epochs": 2} if quick else {}
    learned = DonaldsonLearnedEstimator(DonaldsonLearnedSettings(keep=False, **size))
    begin = time.process_time()
    learned.estimate_batch(data[: 1 if quick else 16])
    training = time.process_time() - begin
    methods: dict[str, Any] = {
        "donaldson": ours, "donaldson-linear": linear, "donaldson-quick": swift,
        "donaldson-learned": learned, "gmm-adam": adam,
        "blasinski": BlasinskiEstimator(plain), "blasinski-cv": BlasinskiEstimator(tuned),
    }  # fmt: skip
    results = {}
    for method, estimator in methods.items():
        results[method] = estimator.estimate_batch(data)
        print(f"{name} {method}", file=sys.stderr, flush=True)
    matrices = {m: np.array([r.matrix for r in found]) for m, found in results.items()}
    error = {m: errors(each, truth) for m, each in matrices.items()}
    nothing = errors(np.zeros_like(truth), truth)[0]
    colours = {
        m: float(np.median(monochromatic_difference(matrices[m], truth, GRID)))
        for m in ("donaldson", "donaldson-learned", "gmm-adam", "blasinski-cv")
    }
    inside = _inside(results["donaldson"], truth)
    between = _inside(results["donaldson"], truth, "quantile")
    by_network = _inside(results["donaldson-learned"], truth)
    below = np.tril(np.ones(truth.shape[1:], dtype=bool), -1)
    low = np.broadcast_to(below, truth.shape)
    flagged = np.array([r.undetermined for r in results["donaldson"]]) & low
    zero = low & ~flagged & (matrices["donaldson"] <= 0.0)
    loop = GmmAdamEstimator(GmmAdamSettings(whole_program=False))
    single = data[:1] if quick else data[:3]
    return {
        "fluo": {m: float(np.median(e[0])) for m, e in error.items()}
        | {"nothing": float(np.median(nothing))},
        "diag": {m: float(np.median(e[1])) for m, e in error.items()},
        "each": {m: error[m] for m in ("donaldson", "donaldson-learned", "gmm-adam")},
        "colour": colours,
        "coverage": [
            float(inside[:, below].mean()),
            float(inside[:, below][truth[:, below] > VISIBLE].mean()),
            float(np.einsum("bii->bi", inside).mean()),
            float(inside[:, below][truth[:, below] > STRONG].mean()),
            float(inside[low & (truth > 0.0) & (truth <= VISIBLE)].mean()),
            float(between[:, below].mean()),
        ],
        "groups": {
            name: [int(inside[where].sum()), int(where.sum())]
            for name, where in (
                ("determined", low & ~flagged & ~zero), ("undetermined", flagged), ("at_zero", zero)
            )
        },
        "coverage_learned": [
            float(by_network[:, below].mean()),
            float(by_network[:, below][truth[:, below] > STRONG].mean()),
        ],
        "misfit": _misfit(data, matrices["donaldson"]),
        "preparation": preparation, "training": training,
        "seconds": {
            "donaldson": processor_seconds(ours, single),
            "donaldson-linear": processor_seconds(linear, single),
            "donaldson-quick": processor_seconds(swift, data),
            "donaldson-learned": processor_seconds(learned, data),
            "gmm-adam": processor_seconds(adam, single),
            "gmm-adam-loop": processor_seconds(loop, data[:1]),
        },
        "weights": {k: getattr(tuned, k) for k in ("alpha", "beta", "gamma", "eta")},
        "status": _counted([r.status.name.lower() for r in results["donaldson"]]),
    }  # fmt: skip


def _inside(results: Sequence[Any], truth: FloatArray, edges: str = "interval") -> Any:
    """Which cells (B, Wo, Wi) lie inside their 90 % intervals, or between the outer quantiles."""
    edge = np.array([getattr(each, edges) for each in results])
    return (truth >= edge[:, 0] - 1e-9) & (truth <= edge[:, -1] + 1e-9)


def _misfit(data: Sequence[Any], matrices: FloatArray) -> FloatArray:
    """Chi-square per capture of matrices (B, Wo, Wi), with the full covariance, (B,)."""
    from estimators.fluorescence.cells import gather

    found = []
    for one, matrix in zip(data, matrices, strict=True):
        captures = gather([one])
        left = captures.value[0] - np.tensordot(captures.design, matrix, 2)
        found.append(left @ np.linalg.solve(captures.covariance[0], left) / left.size)
    return np.array(found)


def processor_seconds(estimator: Any, data: Sequence[Any]) -> float:
    """Processor time [s] of one estimate, the median of several after one that warms up."""
    estimator.estimate(data[0])
    times = []
    for one in data:
        begin = time.process_time()
        estimator.estimate(one)
        times.append(time.process_time() - begin)
    return float(np.median(times))


def _counted(words: Sequence[str]) -> dict[str, int]:
    return {word: words.count(word) for word in sorted(set(words))}


def _summary(found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    def ratio(kind: str, other: str, mine: str = "donaldson") -> dict[str, float]:
        return {name: each[kind][mine] / each[kind][other] for name, each in found.items()}

    def middle(values: dict[str, float]) -> float:
        return float(np.median(list(values.values())))

    fluo, diag = ratio("fluo", "gmm-adam"), ratio("diag", "gmm-adam")
    peer, colour = ratio("fluo", "blasinski-cv"), ratio("colour", "gmm-adam")
    default = ratio("fluo", "blasinski")
    best = {name: max(peer[name], default[name]) for name in found}
    coverage = np.mean([each["coverage"] for each in found.values()], axis=0)
    groups = {
        kind: np.sum([each["groups"][kind] for each in found.values()], axis=0)
        for kind in ("determined", "undetermined", "at_zero")
    }
    cells = sum(int(counted[1]) for counted in groups.values())
    slowest: Callable[[str], float] = lambda m: max(e["seconds"][m] for e in found.values())  # noqa: E731
    ours, whole, loop = slowest("donaldson"), slowest("gmm-adam"), slowest("gmm-adam-loop")
    return {
        "rmse_ratio_fluo": middle(fluo), "rmse_ratio_fluo_by_setup": fluo,
        "rmse_ratio_fluo_sd": _bootstrap(found, "donaldson", 0),
        "rmse_ratio_diag_sd": _bootstrap(found, "donaldson", 1),
        "rmse_ratio_fluo_learned_sd": _bootstrap(found, "donaldson-learned", 0),
        "rmse_ratio_diag": middle(diag), "rmse_ratio_diag_by_setup": diag,
        "rmse_ratio_blasinski": middle(peer), "rmse_ratio_blasinski_by_setup": peer,
        "rmse_ratio_blasinski_best_by_setup": best,
        "rmse_ratio_blasinski_diag": middle(ratio("diag", "blasinski-cv")),
        "rmse_ratio_fluo_linear_by_setup": ratio("fluo", "gmm-adam", "donaldson-linear"),
        "de2000_ratio": middle(colour), "de2000_ratio_by_setup": colour,
        "de2000": {name: each["colour"] for name, each in found.items()},
        "coverage90": float(coverage[0]), "coverage90_visible": float(coverage[1]),
        "coverage90_diag": float(coverage[2]), "coverage90_strong": float(coverage[3]),
        "coverage90_weak": float(coverage[4]), "coverage90_quantiles": float(coverage[5]),
        "coverage90_strong_by_setup": {name: each["coverage"][3] for name, each in found.items()},
        "coverage90_by_setup": {name: each["coverage"][0] for name, each in found.items()},
        **{
            f"coverage90_{kind}": float(counted[0] / counted[1]) if counted[1] else None
            for kind, counted in groups.items()
        },
        "share_undetermined": float(groups["undetermined"][1] / cells),
        "share_at_zero": float(groups["at_zero"][1] / cells),
        "chi_square_reported": [
            max(float(np.median(each["misfit"])) for each in found.values()),
            max(float(each["misfit"].max()) for each in found.values()),
        ],
        "seconds_per_material_quick": slowest("donaldson-quick"),
        "speed_ratio_adam_quick": whole / slowest("donaldson-quick"),
        "rmse_ratio_fluo_quick_by_setup": ratio("fluo", "gmm-adam", "donaldson-quick"),
        "seconds_per_material_learned": slowest("donaldson-learned"),
        "speed_ratio_adam_learned": whole / slowest("donaldson-learned"),
        "rmse_ratio_fluo_learned": middle(ratio("fluo", "gmm-adam", "donaldson-learned")),
        "rmse_ratio_fluo_learned_by_setup": ratio("fluo", "gmm-adam", "donaldson-learned"),
        "rmse_ratio_diag_learned": middle(ratio("diag", "gmm-adam", "donaldson-learned")),
        "de2000_ratio_learned": middle(ratio("colour", "gmm-adam", "donaldson-learned")),
        "rmse_ratio_blasinski_learned": middle(ratio("fluo", "blasinski-cv", "donaldson-learned")),
        "rmse_ratio_diag_learned_by_setup": ratio("diag", "gmm-adam", "donaldson-learned"),
        "coverage90_learned": float(np.mean([e["coverage_learned"][0] for e in found.values()])),
        "coverage90_strong_learned": float(
            np.mean([e["coverage_learned"][1] for e in found.values()])
        ),
        "learned_preparation_seconds": max(each["training"] for each in found.values()),
        "quick_preparation_seconds": max(each["preparation"] for each in found.values()),
        "seconds_per_material": ours, "adam_seconds": whole, "adam_loop_seconds": loop,
        "speed_ratio_adam": whole / ours, "speed_ratio_adam_loop": loop / ours,
        "speed_ratio_adam_linear": whole / slowest("donaldson-linear"),
        "rmse_fluo": {name: each["fluo"] for name, each in found.items()},
        "rmse_diag": {name: each["diag"] for name, each in found.items()},
        "blasinski_weights": {name: each["weights"] for name, each in found.items()},
        "status": {name: each["status"] for name, each in found.items()},
    }  # fmt: skip


def _bootstrap(found: dict[str, dict[str, Any]], mine: str, kind: int) -> float:
    """Standard error of the median ratio to `gmm-adam` (Efron 1979); kind 0: cells, 1: diagonal."""
    random = np.random.Generator(np.random.Philox(key=1))
    ours, theirs = (
        np.array([each["each"][m][kind] for each in found.values()]) for m in (mine, "gmm-adam")
    )
    chosen = random.integers(ours.shape[1], size=(2000, ours.shape[1]))
    ratio = np.median(ours[:, chosen], axis=2) / np.median(theirs[:, chosen], axis=2)
    return float(np.median(ratio, axis=0).std())


def _forward() -> dict[str, float]:
    from twin.fluorescence.fitoolbox import fitoolbox_max_relative_error

    return {"fitoolbox_max_relative_error": fitoolbox_max_relative_error(DATA / "fitoolbox")}
