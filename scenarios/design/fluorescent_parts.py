"""Lights and detectors of fluorescence set-ups, priced one by one, and set-ups made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from scenarios.design.fluorescent_channels import together, white_rates
from twin.errors import InputError
from twin.fluorescence import (
    PRICE_USD,
    Filtered,
    FluorescenceSetup,
    Illuminant,
    Led,
    light_set,
    named_setup,
)
from twin.toml import near_misses

LED_USD = PRICE_USD["L1"] / 8
"""Table 1 of the seed: eight LEDs for 4 dollars."""
FILTER_USD = 5.0
"""Estimate: a cut of a lighting gel."""
PANEL_USD = PRICE_USD["L2"] - 7 * FILTER_USD - LED_USD
"""What of L2 is neither gel nor LED, so that the whole costs what table 1 says."""
PANEL = "panel"
WHITE_LED = "cool_white_led"

# More 5 mm LEDs, as data sheets of these colours have them; drift as L1's of the same die.
_OTHERS = (
    Led(name="royal_blue", peak_nm=445, fwhm_nm=20, power=1.0, nanometres_per_kelvin=0.03,
        per_kelvin=-0.0012, nanometres_per_decade=-2.0),
    Led(name="yellow_green", peak_nm=570, fwhm_nm=22, power=0.4, nanometres_per_kelvin=0.1,
        per_kelvin=-0.007, nanometres_per_decade=1.0),
    Led(name="orange", peak_nm=610, fwhm_nm=17, power=0.7, nanometres_per_kelvin=0.11,
        per_kelvin=-0.008, nanometres_per_decade=1.0),
    Led(name="deep_red", peak_nm=660, fwhm_nm=20, power=0.8, nanometres_per_kelvin=0.12,
        per_kelvin=-0.005, nanometres_per_decade=1.0),
)  # fmt: skip


@dataclass(frozen=True)
class PricedLight:
    """One light of the list.

    Attributes:
        light: its spectrum, its power on the scale of its own set.
        price_usd: price [USD] of the light alone.
        shares: what several lights need once (a panel, a white LED behind gels), "" for nothing.
        family: "L1" (5 mm LEDs), "L2" (filters on a panel) or "gel" (filters on a white LED).
    """

    light: Illuminant
    price_usd: float
    shares: str
    family: str


@lru_cache(maxsize=1)
def priced_lights() -> dict[str, PricedLight]:
    """All lights by name.

    The eight of L1; four more LEDs; `near_ultraviolet` and, as `panel_...`, the seven filters of
    L2; the same filters on one of L1's white LEDs as `gel_...`.
    """
    found = {each.name: PricedLight(each, LED_USD, "", "L1") for each in light_set("L1")}
    found |= {each.name: PricedLight(each, LED_USD, "", "L1") for each in _OTHERS}
    white = found["cool_white"].light
    for each in light_set("L2"):
        if not isinstance(each, Filtered):
            found[each.name] = PricedLight(each, LED_USD, "", "L2")
            continue
        on_panel = each.model_copy(update={"name": f"panel_{each.name}"})
        on_led = each.model_copy(update={"name": f"gel_{each.name}", "power": white.power})
        found[on_panel.name] = PricedLight(on_panel, FILTER_USD, PANEL, "L2")
        found[on_led.name] = PricedLight(on_led, FILTER_USD, WHITE_LED, "gel")
    return found


SHARED_USD = {PANEL: PANEL_USD, WHITE_LED: LED_USD, "": 0.0}


def price_of(names: Sequence[str], detector: str) -> float:
    """Price [USD] of some lights and a detector ("S1" or "S2").

    Raises:
        InputError: an unknown light or detector.
    """
    if detector not in ("S1", "S2"):
        raise InputError(f"the detector {detector!r}", "S1 or S2", place="detector")
    chosen = [_light(name) for name in names]
    shared = {each.shares for each in chosen}
    if "cool_white" in names:
        shared.discard(WHITE_LED)
    own = sum(each.price_usd for each in chosen)
    return own + sum(SHARED_USD[each] for each in shared) + PRICE_USD[detector]


def assembled(names: Sequence[str], detector: str) -> FluorescenceSetup:
    """A set-up of some lights and a detector, every light as bright as in its own set.

    Raises:
        InputError: no light, an unknown light or detector.
    """
    if not names:
        raise InputError("no light", "one or more", place="lights")
    price = price_of(names, detector)
    rates = _rates(detector)
    made = together(
        named_setup(f"l1-{detector.lower()}"),
        [_light(name).light for name in names], [rates[name] for name in names],
    )  # fmt: skip
    label = f"{len(names)} lights, {detector}"
    return made.model_copy(update={"name": label, "price_usd": price})


@lru_cache(maxsize=4)
def _rates(detector: str) -> dict[str, float]:
    """Signal [electrons/s] of the white under each light, in the set that it comes from."""
    found: dict[str, float] = {}
    lights = priced_lights()
    like = named_setup(f"l1-{detector.lower()}")
    first = white_rates(like).max()
    for families, reference in ((("L1", "gel"), "L1"), (("L2",), "L2")):
        own = [each.light for each in lights.values() if each.family in families]
        rates = white_rates(like.model_copy(update={"lights": tuple(own)}))
        known = {each.name for each in light_set(reference)}
        known |= {f"panel_{name}" for name in known}
        brightest = max(rate for each, rate in zip(own, rates, strict=True) if each.name in known)
        for each, rate in zip(own, rates, strict=True):
            found[each.name] = float(rate / brightest * first)
    return found


def _light(name: str) -> PricedLight:
    known = priced_lights()
    if name not in known:
        raise InputError(
            f"the light {name!r}", f"one of {', '.join(known)}", place="lights",
            remedy=near_misses(name, list(known)),
        )  # fmt: skip
    return known[name]


SEED_LIGHTS: dict[str, tuple[str, ...]] = {
    "L1": tuple(each.name for each in light_set("L1")),
    "L2": tuple(
        f"panel_{each.name}" if isinstance(each, Filtered) else each.name
        for each in light_set("L2")
    ),
}
"""Lights of the seed's two sets by the names of `priced_lights`."""
