"""A design study as the page shows it: its set-ups, what they cost, and what each would reach.

Read from the design.json of `benchtwin design`. That file keeps the set-ups of the Pareto front, of
the greedy path and the assemblies beside them; of all others it says only how many there were.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.errors import InputError
from twin.toml import read_text

if TYPE_CHECKING:
    from scenarios.design.parts import Parts

RESULT, CANDIDATES = "design.json", "candidates"
PROTOCOL = ("averages", "repeats", "acceptance_deg", "polar_deg", "leds")
PRICED = re.compile(r"# (?P<title>.+): (?P<price>[0-9.e+]+) USD \((?P<source>.*)\)")
"""A part in the head of a candidate's scenario file."""


@dataclass(frozen=True)
class PricedPart:
    """A part's name, its title, its price [USD] (None: unknown), and who said so."""

    name: str
    title: str = ""
    price_usd: float | None = None
    source: str = ""


@dataclass(frozen=True)
class SetUp:
    """Parts and a protocol with their predicted figures.

    Attributes:
        id: the study's.
        price_usd: [USD].
        score: largest figure over its target: 1 or less is good enough.
        figures: by target.
        parts: with prices where they are known.
        thickness_mm: of the samples [mm].
        protocol: frames, shots, angles [deg], lights.
        on_front: whether none beats it in price and score.
        file: scenario that says it again, or None.
        effects: figures with the catalogue's effects at their usual sizes, where they are known.
        simulated: actual over predicted errors by parameter, where it was simulated.
        limits: by target: inputs and their share of its variance, where they are known.
    """

    id: str
    price_usd: float
    score: float
    figures: Mapping[str, float]
    parts: tuple[PricedPart, ...]
    thickness_mm: tuple[float, ...]
    protocol: Mapping[str, float]
    on_front: bool
    file: Path | None
    effects: Mapping[str, float]
    simulated: Mapping[str, float]
    limits: Mapping[str, Mapping[str, float]]

    def changes(self, other: SetUp) -> list[str]:
        """What becomes what on the way to another set-up."""
        found = [
            f"{own.name} → {new.name}"
            for own, new in zip(self.parts, other.parts, strict=True)
            if own.name != new.name
        ]
        if self.thickness_mm != other.thickness_mm:
            found.append(f"{millimetres(self.thickness_mm)} → {millimetres(other.thickness_mm)}")
        return found + [
            f"{name.removesuffix('_deg')} {own:g} → {other.protocol[name]:g}"
            for name, own in self.protocol.items()
            if own != other.protocol[name]
        ]


@dataclass(frozen=True)
class Beside:
    """An assembly that the goal compares: its name, price [USD], score and figures."""

    name: str
    price_usd: float
    score: float
    figures: Mapping[str, float]


@dataclass(frozen=True)
class Design:
    """What a design.json says.

    Attributes:
        title: of the goal.
        reached: whether a set-up meets all targets.
        targets: largest figures that are good enough.
        answer: id of the cheapest set-up that meets them, else of the most accurate.
        setups: of the front and the greedy path, by price.
        compared: assemblies beside them.
        looked: how many candidates the study looked at.
        complete: whether those are all there are within the budget.
    """

    title: str
    reached: bool
    targets: Mapping[str, float]
    answer: str
    setups: tuple[SetUp, ...]
    compared: tuple[Beside, ...]
    looked: int
    complete: bool

    def setup(self, id_: str) -> SetUp:
        """The set-up of an id; the answer for one that is not there."""
        by_id = {each.id: each for each in self.setups}
        return by_id.get(id_) or by_id[self.answer]

    @property
    def front(self) -> tuple[SetUp, ...]:
        """The Pareto front, cheapest first."""
        return tuple(each for each in self.setups if each.on_front)

    def better(self, than: SetUp) -> tuple[SetUp, ...]:
        """The set-ups of the front that are more accurate, cheapest first."""
        return tuple(each for each in self.front if each.score < than.score)


def millimetres(thickness_mm: tuple[float, ...]) -> str:
    """Thicknesses in words."""
    return " + ".join(f"{mm:g}" for mm in thickness_mm) + " mm"


def read_design(path: Path) -> Design:
    """Read the design.json that `benchtwin design` wrote; its folder will do.

    Raises:
        InputError: no such file, or another one.
    """
    file = path / RESULT if path.is_dir() else path
    text = read_text(file)
    try:
        return _design(json.loads(text), file.parent / CANDIDATES)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        said = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"a file that is no design study ({said})", "a design.json of benchtwin design",
            file=file, remedy="Make one: benchtwin design resin --no-simulate --out study",
        ) from error  # fmt: skip


def _design(facts: dict[str, Any], folder: Path) -> Design:
    from scenarios.design.parts import load_parts

    targets = {str(name): float(value) for name, value in facts["targets"].items()}
    answer = str(facts["answer"]["id"])
    front = {str(row["id"]) for row in facts["front"]}
    by_id = {
        str(row["id"]): row for row in [*facts["front"], *facts["greedy"], facts["answer"]]
    }  # fmt: skip
    robust = {each["id"]: each["figures"] for each in facts.get("robust") or ()}
    verified = {each["id"]: each.get("ratio") or {} for each in facts.get("verified") or ()}
    library = load_parts()
    setups = [
        SetUp(
            id_, float(row["price_usd"]), float(row["score"]), _figures(row, targets),
            _parts(id_, row, library, folder),
            tuple(float(mm) for mm in row["thickness_mm"]),
            {name: float(row[name]) for name in PROTOCOL},
            id_ in front,
            file if (file := folder / f"{id_}.toml").is_file() else None,
            {name: float(own["with_effects"]) for name, own in robust.get(id_, {}).items()},
            {name: float(ratio) for name, ratio in verified.get(id_, {}).items()},
            _limits(facts) if id_ == answer else {},
        )
        for id_, row in by_id.items()
    ]  # fmt: skip
    compared = []
    for row in facts["compared"]:
        own = _figures(row, targets)
        score = max(own[name] / target for name, target in targets.items())
        compared.append(Beside(str(row["name"]), float(row["price_usd"]), score, own))
    found = facts["search"]
    return Design(
        str(facts["title"]), bool(facts["reached"]), targets, answer,
        tuple(sorted(setups, key=lambda each: (each.price_usd, -each.score))),
        tuple(compared), int(found["candidates"]), bool(found["complete"]),
    )  # fmt: skip


def _figures(row: dict[str, Any], targets: Mapping[str, float]) -> dict[str, float]:
    return {name: float(row["figures"][name]) for name in targets}


def _limits(facts: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Inputs by target, the largest share first."""
    return {
        target: dict(sorted(own.items(), key=lambda each: -each[1]))
        for target, own in facts["limits"].items()
    }


def _parts(id_: str, row: dict[str, Any], library: Parts, folder: Path) -> tuple[PricedPart, ...]:
    """Parts with the study's prices.

    An id is made of all that a set-up's parts say, so where ours give the same id, their prices
    are the study's; else those in the head of its scenario file are, and without one none.
    """
    from scenarios.design.candidate import Candidate

    names = tuple(str(name) for name in row["parts"])
    own = Candidate(
        names, tuple(row["thickness_mm"]), *(row[name] for name in PROTOCOL)
    )  # fmt: skip
    if set(names) <= set(library.by_name) and own.id(library) == id_:
        return tuple(
            PricedPart(part.name, part.title, part.price_usd, part.price_source)
            for part in own.chosen(library)
        )
    file = folder / f"{id_}.toml"
    said = [PRICED.fullmatch(line) for line in _head(file)] if file.is_file() else []
    priced = [
        PricedPart(name, match["title"], float(match["price"]), match["source"])
        for name, match in zip(names, filter(None, said), strict=False)
    ]
    return tuple(priced) if len(priced) == len(names) else tuple(PricedPart(n) for n in names)


def _head(file: Path) -> list[str]:
    lines = read_text(file).splitlines()
    return [line for line in lines[:40] if line.startswith("# ")]
