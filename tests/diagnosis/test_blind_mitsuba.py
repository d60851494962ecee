"""The check on Mitsuba's renders: what is withheld, what is a closed form, what is kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import blind_mitsuba, mitsuba_visit
from benchmarks.blind_mitsuba import CASES, NOTHING, SCALES, judged, scenario, world_of
from benchmarks.mitsuba_scene import SlabCase
from benchmarks.mitsuba_visit import Studio, Truth, unscattered
from twin.effects import World, candidate
from twin.transport import captures

SLAB = SlabCase(1.5, 0.0, 2.0, 0.0, 0.8, "", 0.0)


def test_every_case_differs_from_its_description_by_three_prior_scales() -> None:
    for case in CASES:
        described = scenario(100.0, case.described_n)
        world, away = world_of(described, case)
        if case.name == NOTHING:
            assert away == ()
            continue
        found = candidate(World.nominal(described.bench, described.samples), case.name)
        scales = [SCALES * each.prior_scale for each in found.parameters]
        assert np.abs(away) == pytest.approx(scales)
        same = world.bench == described.bench and world.samples == described.samples
        assert same == (case.name in ("phase_function", "reference_plane"))
        assert "0.8" not in case.name or world.samples[1].thickness_mm == pytest.approx(0.848)


def test_what_is_rendered_is_index_matched_whatever_is_described() -> None:
    for case in CASES:
        world, _ = world_of(scenario(100.0, case.described_n), case)
        assert {round(float(sample.n), 9) for sample in world.samples} == {1.0}  # type: ignore[arg-type]


def test_the_unscattered_part_is_that_of_a_slab_without_scattering() -> None:
    described = scenario(100.0, 1.5)
    clear = {"albedo": 0.0, "sigma_t_per_mm": 2.0, "g": 0.0}
    sample = described.samples[1].model_copy(update={"material": _medium(clear)})
    seen = captures(described.bench, sample, np.array([500.0]), paths=256, seed=1)
    assert unscattered(SLAB) == pytest.approx(float(seen.collimated[0]), rel=1e-6)


def test_a_render_is_made_once_and_counts_against_a_rendered_white(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = []

    def passes(*given: Any) -> dict[str, float]:
        made.append(given[-1])
        return {"value": 0.1 + 0.01 * len(made), "standard_error": 0.001, "seconds": 2.0}

    monkeypatch.setattr(mitsuba_visit, "_passes", passes)
    truth = [Truth(SLAB, (0.02, 0.98)), Truth(SLAB, (0.03, 0.98))]
    bench = scenario(100.0).bench
    first = Studio(bench, 0.01, tmp_path).captures(truth, np.array([500.0, 600.0]))
    # a white, black twice with two reflectances, white once for both wavelengths
    assert len(made) == 4
    assert len(set(made)) == 4
    studio = Studio(bench, 0.01, tmp_path)
    again = studio.captures(truth, np.array([500.0, 600.0]))
    assert len(made) == 4
    assert sum(studio.used.values()) == 8.0
    assert np.array_equal(first.black, again.black)
    white = np.pi * 0.11
    assert first.white_reference_factor == pytest.approx(white)
    assert first.black[0] == pytest.approx(np.pi * 0.12 / white)
    assert first.collimated == pytest.approx(unscattered(SLAB))


def test_a_row_says_whether_the_truth_was_named() -> None:
    case = CASES[1]
    effect = {"name": case.name, "probability": 0.9, "parameters": [{"value": 0.014, "sd": 0.001}]}
    found = {
        "verdict": "effect", "leading": [case.name], "p": 1e-3, "effects": [effect],
        "credible_set": [case.name], "leading_set": [case.name], "unknown_probability": 0.0,
        "closure": {"value": 0.9, "interval": [0.8, 1.0]}, "not_identifiable": [],
    }  # fmt: skip
    row = judged(found, case, [0.015])
    assert row["named"]
    assert row["in_set"]
    assert row["rank"] == 1
    other = judged({**found, "leading": ["gap"], "verdict": "cannot_tell"}, case, [0.015])
    assert not other["named"]
    text = blind_mitsuba.table([row, judged({**found, "verdict": "no_gap"}, CASES[0], [])])
    assert "| black_level | 0.015 | effect | black_level |" in text
    assert "0.90 (0.80 to 1.00)" in text


def _medium(values: dict[str, float]) -> Any:
    from twin.bench import Medium

    return Medium(**values)
