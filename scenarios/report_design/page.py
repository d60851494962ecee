"""The report of a design study as one offline HTML page."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from scenarios.report_design.plots import draw_front, draw_limits, draw_verification

if TYPE_CHECKING:
    from scenarios.design.study import Study

SHOWN = 0.005
"""Share of a variance below which an input is not listed."""


def design_page(study: Study) -> str:
    """The page as text: the same study gives the same text."""
    import jinja2
    from markupsafe import Markup

    from scenarios.simulate import software

    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    text = resources.files("scenarios.report_design").joinpath("page.html.j2")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    found = study.found
    verified = draw_verification(study)
    return environment.from_string(text.read_text("utf-8")).render(
        style=Markup(style),
        title=study.goal.title,
        tone="good" if study.reached else "poor",
        verdict=study.verdict(),
        targets=[
            [name, f"{target:g}", f"{value:.3g}", "yes" if value <= target else "no"]
            for name, target, value in zip(
                study.goal.targets.names, study.goal.targets.values,
                found.figures[study.answer], strict=True,
            )
        ],
        figure_names=list(study.goal.targets.names),
        fluorescent=study.goal.targets.fluorescent,
        looked=len(found.candidates),
        method=found.method,
        complete=found.complete,
        front=Markup(draw_front(study)),
        limits=Markup(draw_limits(study)),
        verified=Markup(verified) if verified else None,
        bought=_bought(study, found.front),
        greedy=_bought(study, found.path),
        compared=[
            [name, f"{own.price(study.parts):g}", *(f"{value:.3g}" for value in figures)]
            for name, own, figures in study.compared
        ],
        parts=[
            [part.title, f"{part.price:g}", part.price_source,
             str(part.priced_on or "-"), part.source]
            for part in found.candidates[study.answer].chosen(study.parts)
        ],
        shares=[
            [target, name, f"{100 * share:.1f} %"]
            for target, own in study.limits.items()
            for name, share in own.items()
            if share >= SHOWN
        ],
        checks=_checks(study),
        robust=_robust(study),
        weakest=_weakest(study),
        software=software(),
    )  # fmt: skip


def _bought(study: Study, numbers: tuple[int, ...]) -> list[list[str]]:
    """Steps from one candidate to the next dearer one: price, what changes, what it gains."""
    found, rows = study.found, []
    before = None
    for number in numbers:
        own = found.candidates[number]
        row = [own.id(study.parts), f"{found.price_usd[number]:g}"]
        row += [f"{value:.3g}" for value in found.figures[number]]
        if before is None:
            rows.append([*row, own.text, ""])
        else:
            last = found.candidates[before]
            changed = [name for name in own.parts if name not in last.parts]
            if own.thickness_mm != last.thickness_mm:
                changed.append(" + ".join(f"{mm:g}" for mm in own.thickness_mm) + " mm")
            changed += [
                f"{name} {getattr(own, name):g}"
                for name in ("averages", "repeats", "acceptance_deg", "polar_deg", "leds")
                if getattr(own, name) != getattr(last, name)
            ]
            gain = float(found.score[before] / found.score[number])
            rows.append([*row, ", ".join(changed), f"{gain:.2f} times better"])
        before = number
    return rows


def _checks(study: Study) -> list[list[str]]:
    rows = []
    for each in study.verified:
        head = [each.candidate.id(study.parts), f"{each.candidate.price(study.parts):g}"]
        if each.failure:
            rows.append([*head, each.failure, "", "", ""])
            continue
        good = np.all((each.ratio >= 0.85) & (each.ratio <= 1.15))
        rows.append(
            [
                *head,
                *(" / ".join(f"{v:.2f}" for v in values)
                  for values in (each.ratio, each.bias, each.width_ratio)),
                "yes" if good else "no",
            ]
        )  # fmt: skip
    return rows


def _robust(study: Study) -> list[list[str]]:
    rows = []
    for each in study.robust:
        meets = all(
            both <= target
            for (_, both), target in zip(
                each.figures.values(), study.goal.targets.values, strict=True
            )
        )
        figures = [f"{plain:.3g} → {both:.3g}" for plain, both in each.figures.values()]
        visible = len(each.effects) - len(each.hidden)
        more = "-" if each.next_mm is None else f"{each.next_mm[0]:g} mm (+{each.next_mm[1]})"
        rows.append(
            [each.candidate.id(study.parts), f"{each.candidate.price(study.parts):g}", *figures,
             "yes" if meets else "no", f"{visible} of {len(each.effects)}",
             str(len(each.apart)), more]
        )  # fmt: skip
    return rows


def _weakest(study: Study) -> list[list[str]]:
    """Effects that would move the answer most."""
    if not study.robust:
        return []
    own = study.robust[0]
    targets = dict(zip(study.goal.targets.names, study.goal.targets.values, strict=True))

    def size(name: str) -> float:
        moved = own.effects[name][0]
        return max((moved[t] / targets[t] for t in moved), default=0.0)

    return [
        [name, *(f"{own.effects[name][0].get(t, float('nan')):.2g}" for t in targets),
         f"{own.effects[name][1]:.1f}"]
        for name in sorted(own.effects, key=size, reverse=True)[:8]
    ]  # fmt: skip
