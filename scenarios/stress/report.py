"""The report of a stress test: one HTML page that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from scenarios.report.build import flattened
from scenarios.simulate import software
from scenarios.stress.cost_report import cost_sections, entry_rows
from scenarios.stress.parts import Case, Outcome, Setting
from scenarios.stress.plan import NONE
from scenarios.stress.plots import draw_coverage, draw_errors, draw_heat
from scenarios.stress.ranking import ranking
from scenarios.stress.score import PARAMETERS, Answers, Score, errors_of, status_name
from scenarios.stress.tables import light_facts, worlds_of

WORST = 12
"""Rows of the table of the most overconfident points."""
SHOWN = {"albedo": "albedo", "sigma_t_per_mm": "σt", "g": "g"}


def render(outcome: Outcome, scores: Mapping[Case, Score], name: str) -> str:
    """The page as text: the same outcome gives the same text; times are not in it.

    Args:
        outcome: what was run.
        scores: by case.
        name: of the plan, for the command that repeats it.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    template = environment.from_string(
        resources.files("scenarios.stress").joinpath("stress.html.j2").read_text("utf-8")
    )
    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    worlds = [
        _world(outcome, scores, setting, number=i) for i, setting in enumerate(worlds_of(outcome))
    ]
    return template.render(
        style=Markup(style),
        title=outcome.plan.title,
        worlds=worlds,
        costs=cost_sections(outcome, scores),
        entries=entry_rows(outcome.plan),
        points=len(outcome.design),
        thicknesses=", ".join(f"{t:g}" for t in outcome.plan.thickness_mm),
        verdict=_verdict(worlds),
        raised=outcome.raised,
        settings=flattened(
            outcome.plan.model_dump(mode="json", exclude={"benches", "title", "effects"})
        ),
        benches=flattened(outcome.plan.model_dump(mode="json", include={"benches"})),
        software=software(),
        command=f"benchtwin stress {name} --seed {outcome.plan.seed}",
    )


def _world(
    outcome: Outcome, scores: Mapping[Case, Score], setting: Setting, *, number: int
) -> dict[str, Any]:
    """What the template shows of one bench at one noise level with one set of effects."""
    from markupsafe import Markup

    truth = outcome.design.material
    answers = {
        case.estimator: own for case, own in outcome.answers.items() if case.setting == setting
    }
    mine = {case.estimator: own for case, own in scores.items() if case.setting == setting}
    thin = min(outcome.plan.thickness_mm)
    ceilings = tuple(
        _ceiling([np.abs(errors_of(truth, a.value))[a.claimed[:, i], i] for a in answers.values()])
        for i in range(3)
    )
    heats = [
        (title, Markup(draw_heat(truth, thin, own, ceilings, f"heat{number}-{place}")))
        for place, (title, own) in enumerate(answers.items())
    ]
    return {
        "id": f"world{number}",
        "name": _name(outcome, setting),
        "ranking": [_rank_row(row, mine[row["estimator"]]) for row in ranking(mine)],
        "scores": [_score_row(t, p, s) for t, score in mine.items() for p, s in _parts(score)],
        "statuses": [(title, _counts(score)) for title, score in mine.items()],
        "errors": Markup(draw_errors(truth, answers, f"errors{number}")),
        "coverage": Markup(draw_coverage(mine, f"coverage{number}")),
        "heats": heats,
        "worst": _worst(truth, answers),
        "light": light_facts(outcome, *setting),
    }


def _name(outcome: Outcome, setting: Setting) -> str:
    text = f"Bench “{setting.bench}”, noise × {setting.noise:g}"
    if not outcome.plan.effects:
        return text
    return f"{text}, {'no effects' if setting.effects == NONE else f'with “{setting.effects}”'}"


def _verdict(worlds: list[dict[str, Any]]) -> list[str]:
    """The first lines: who is best, and who says more than it knows."""
    lines = []
    for world in worlds:
        first = world["ranking"][0]
        bad = [row["estimator"] for row in world["ranking"] if "too narrow" in row["intervals"]]
        text = f"{world['name']}: {first['estimator']} errs least"
        if bad:
            text += f"; intervals too narrow: {', '.join(bad)}"
        lines.append(text + ".")
    return lines


def _rank_row(row: Mapping[str, Any], score: Score) -> dict[str, str]:
    ratio = row["error_ratio"]
    intervals = "; ".join(f"{SHOWN[n]} {v}" for n, v in row["intervals"].items() if v != "none")
    return {
        "estimator": row["estimator"],
        "ratio": f"{ratio:.2f}" if math.isfinite(ratio) else "leaves parameters out",
        "errors": " · ".join(_figure(score.parameters[n].median_error_all) for n in PARAMETERS),
        "intervals": intervals or "none stated",
        "overconfident": _percent(row["overconfident"]),
        "answered": _percent(row["answered"]),
    }


def _parts(score: Score) -> list[tuple[str, Any]]:
    return [(name, own) for name, own in score.parameters.items() if own.claimed]


def _score_row(title: str, name: str, score: Any) -> list[str]:
    shares = [
        f"{100 * share.value:.0f} ({100 * share.interval[0]:.0f}–{100 * share.interval[1]:.0f})"
        if share.total
        else "–"
        for share in score.coverage
    ]
    return [
        title,
        SHOWN[name],
        str(score.claimed),
        f"{_signed(score.bias)} ± {_figure(score.bias_error)}",
        _figure(score.spread),
        _figure(score.median_error),
        _figure(score.z_spread),
        *shares,
        _percent(score.overconfident.value),
    ]


def _counts(score: Score) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in score.status.items())


def _worst(truth: np.ndarray, answers: Mapping[str, Answers]) -> list[list[str]]:
    """Claimed values furthest from the truth in stated standard errors, beyond five of them."""
    rows: list[tuple[float, list[str]]] = []
    for title, own in answers.items():
        with np.errstate(invalid="ignore", divide="ignore"):
            z = np.where(own.claimed, (own.value - truth) / own.sigma, np.nan)
        for point, index in np.argwhere(np.abs(z) > 5.0):
            albedo, sigma_t, g = truth[point]
            rows.append(
                (
                    -abs(z[point, index]),
                    [
                        title,
                        str(point),
                        f"{albedo:.4f}, {sigma_t:.3g} /mm, {g:.3f}",
                        SHOWN[PARAMETERS[index]],
                        f"{own.value[point, index]:.4g} ± {own.sigma[point, index]:.2g}",
                        f"{z[point, index]:+.1f}",
                        status_name(int(own.status[point])).replace("_", " "),
                    ],
                )
            )
    return [row for _, row in sorted(rows)[:WORST]]


def _ceiling(errors: list[np.ndarray]) -> float:
    every = np.concatenate(errors) if errors else np.array([])
    every = every[np.isfinite(every) & (every > 0)]
    if every.size == 0:
        return 1.0
    return float(10.0 ** np.ceil(np.log10(np.quantile(every, 0.98))))


def _figure(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.2g}" if math.isfinite(value) else "none"


def _signed(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:+.2g}".replace("-", "−")


def _percent(share: float) -> str:
    return "–" if math.isnan(share) else f"{100 * share:.1f} %"
