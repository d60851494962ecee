"""The report of a design study as one offline HTML page."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from scenarios.design.verified import meets
from scenarios.design.wording import FIGURES, headline, input_title, made_of, simulation
from scenarios.report_design.plots import draw_front, draw_limits, draw_verification

if TYPE_CHECKING:
    from scenarios.design.study import Study

SHOWN = 0.005
"""Share of a variance below which an input is not listed."""
METHODS = {
    "exhaustive": "all of them, one by one",
    "greedy": "one change at a time",
    "bayes": "a Bayesian optimiser and one change at a time",
}
PROTOCOL = {
    "averages": " frames a shot", "repeats": " shots", "acceptance_deg": "° of view",
    "polar_deg": "° of the panels", "leds": " lights",
}  # fmt: skip
"""Decisions of the protocol, as they stand behind their number."""


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
    found, own = study.found, study.simulated_answer
    verified = draw_verification(study)
    simulated = own is not None and bool(own.figures)
    return environment.from_string(text.read_text("utf-8")).render(
        style=Markup(style),
        title=study.goal.title,
        tone=_tone(study),
        headline=headline(study),
        simulation=simulation(study),
        made_of=made_of(found.candidates[study.answer], study.parts),
        targets=_targets(study),
        simulated=simulated,
        figure_names=[FIGURES[name] for name in study.goal.targets.names],
        fluorescent=study.goal.targets.fluorescent,
        looked=len(found.candidates),
        method=METHODS[found.method],
        complete=found.complete,
        front=Markup(draw_front(study)),
        limits=Markup(draw_limits(study)),
        verified=Markup(verified) if verified else None,
        bought=_bought(study, found.front),
        greedy=_bought(study, found.path),
        compared=[
            [study.parts.assembly(name).title, f"{each.price(study.parts):g}",
             *(f"{value:.3g}" for value in figures)]
            for name, each, figures in study.compared
        ],
        parts=[
            [part.title, f"{part.price:g}", part.price_source,
             str(part.priced_on or "-"), part.source]
            for part in found.candidates[study.answer].chosen(study.parts)
        ],
        shares=_shares(study),
        checks=_checks(study),
        robust=_robust(study),
        weakest=_weakest(study),
        software=software(),
    )  # fmt: skip


def _tone(study: Study) -> str:
    """Colour of the verdict: a claim that its simulation does not bear out is not a good one."""
    if not study.reached:
        return "poor"
    return "good" if study.meets_in_simulation in ("yes", "not simulated") else "mixed"


def _targets(study: Study) -> list[list[str]]:
    """Every figure of the answer: target, predicted, met; and the same of its simulation."""
    own = study.simulated_answer
    figures = {} if own is None else own.figures
    rows = []
    for name, target, value in zip(
        study.goal.targets.names, study.goal.targets.values, study.found.figures[study.answer],
        strict=True,
    ):  # fmt: skip
        row = [FIGURES[name], f"{target:g}", f"{value:.3g}", "yes" if value <= target else "no"]
        if name in figures:
            seen, error = figures[name]
            row += [f"{seen:.3g} ± {error:.1g}", meets(seen, error, target)]
        elif figures:
            row += ["-", "-"]
        rows.append(row)
    return rows


def _shares(study: Study) -> list[list[str]]:
    """Inputs with their share of every figure's variance [%], the largest first."""
    every = {name for own in study.limits.values() for name in own}
    largest = {name: max(own.get(name, 0.0) for own in study.limits.values()) for name in every}
    return [
        [input_title(name), *(f"{100 * own.get(name, 0.0):.1f}" for own in study.limits.values())]
        for name in sorted(every, key=lambda name: (-largest[name], name))
        if largest[name] >= SHOWN
    ]


def _bought(study: Study, numbers: tuple[int, ...]) -> list[list[str]]:
    """Steps from one candidate to the next dearer one: price, what changes, what it gains."""
    found, rows = study.found, []
    before = None
    for number in numbers:
        own = found.candidates[number]
        row = [own.id(study.parts), f"{found.price_usd[number]:g}"]
        row += [f"{value:.3g}" for value in found.figures[number]]
        if before is None:
            rows.append([*row, made_of(own, study.parts), ""])
        else:
            last = found.candidates[before]
            changed = [study.parts.part(name).title for name in own.parts if name not in last.parts]
            if own.thickness_mm != last.thickness_mm:
                changed.append(" + ".join(f"{mm:g}" for mm in own.thickness_mm) + " mm")
            changed += [
                f"{getattr(own, name):g}{what}"
                for name, what in PROTOCOL.items()
                if getattr(own, name) != getattr(last, name)
            ]
            gain = float(found.score[before] / found.score[number])
            rows.append([*row, "; ".join(changed), f"{gain:.2f}"])
        before = number
    return rows


def _checks(study: Study) -> list[list[str]]:
    rows = []
    for each in study.verified:
        head = [each.candidate.id(study.parts), f"{each.candidate.price(study.parts):g}"]
        if each.failure:
            rows.append([*head, each.failure, "", "", "", ""])
            continue
        columns = (each.ratio, each.ratio_error, each.bias, each.width_ratio)
        rows.append(
            [
                *head,
                *(" / ".join(f"{v:.2f}" for v in values) for values in columns),
                "yes" if each.agrees else "no",
            ]
        )
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
        more = "-"
        if each.next_mm is not None:
            more = f"{each.next_mm[0]:g} mm ({each.next_mm[1]} more)"
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
        [input_title(name), *(f"{own.effects[name][0].get(t, float('nan')):.2g}" for t in targets),
         f"{own.effects[name][1]:.1f}"]
        for name in sorted(own.effects, key=size, reverse=True)[:8]
    ]  # fmt: skip
