"""The unbounded bench told by the same paths: right mean, and a difference with little noise."""

from __future__ import annotations

import numpy as np
import pytest

from twin.adding_doubling import captures_model, make_streams
from twin.bench import Bench, Sample
from twin.materials import OpticalProperties
from twin.transport import Effort, beam_setup, flat_stacks, mean_and_error, panels_setup, trace
from twin.transport.engine import BLACK, UNBOUNDED_STACK, WHITE, Tallies

NOMINAL = np.array([550.0])
ALBEDO = np.array([0.4, 0.9, 0.99])
RHO = {BLACK: 0.03, WHITE: 0.98}
BARE = Bench(covers_above=(), covers_below=())
SCENES = {
    "matched": (BARE, 1.0, 2.0, 0.0, 1.0),
    "bare": (BARE, 1.5, 1.0, 0.6, 0.5),
    "covers": (Bench(), 1.5, 6.0, 0.85, 0.5),
    "one panel": (Bench(panels=Bench().panels[:1]), 1.4, 3.0, 0.3, 0.5),
}


def paired(name: str, beam: bool = False, log2_paths: int = 8) -> tuple[Tallies, Bench, Sample]:
    bench, n, sigma_t, g, thickness = SCENES[name]
    sample = Sample(name="s", thickness_mm=thickness, n=n)
    medium = OpticalProperties(NOMINAL, np.zeros(1), np.array([sigma_t]), np.array([g]), None)
    stack = flat_stacks(bench, sample, NOMINAL, medium)[0]
    setup = beam_setup(bench) if beam else panels_setup(bench, stack.height)
    effort = Effort(blocks=48, log2_paths=log2_paths, paired=True)
    return trace(stack, setup, effort, seed=21, stream=3), bench, sample


def plane(name: str, g_shift: float = 0.0):
    bench, n, sigma_t, g, _ = SCENES[name]
    sample = Sample(name="s", thickness_mm=SCENES[name][4], n=n)
    streams = make_streams(24, 0) if n == 1.0 else make_streams(16, 16)
    model = captures_model(bench, [sample], np.full(len(ALBEDO), 550.0), streams=streams)
    parts = model.parts(model.parameters(ALBEDO, sigma_t, g + g_shift))
    return [np.asarray(part)[:, 0] for part in parts]


@pytest.mark.parametrize("name", SCENES)
def test_the_unbounded_bench_is_that_of_adding_doubling(name: str) -> None:
    tallies, _, _ = paired(name)
    series = tallies.blocks_by_albedo(UNBOUNDED_STACK, ALBEDO)
    worst = {}
    for shift in (0.0, 0.05):
        direct, once, returned, _, _ = plane(name, shift)
        z = []
        for rho in RHO.values():
            mean, error = mean_and_error(series @ rho**tallies.bounce)
            z.append((mean - direct - rho * once / (1.0 - rho * returned)) / error)
        worst[shift] = float(np.abs(z).max())
    assert worst[0.0] < 4.0
    assert worst[0.05] > 6.0  # the control: a medium whose g is 0.05 more


@pytest.mark.parametrize("name", ["matched", "covers"])
def test_what_the_beam_scatters_into_the_cone_is_that_of_adding_doubling(name: str) -> None:
    tallies, _, _ = paired(name, beam=True)
    mean, error = mean_and_error(tallies.blocks_by_albedo(UNBOUNDED_STACK, ALBEDO)[..., 0])
    assert np.all(np.abs(mean - plane(name)[4]) < 4.0 * error)
    assert np.any(np.abs(mean - plane(name, 0.05)[4]) > 6.0 * error)


@pytest.mark.parametrize("name", SCENES)
def test_a_paired_trace_gives_the_same_finite_bench_and_a_quiet_difference(name: str) -> None:
    tallies, bench, sample = paired(name)
    _, _, sigma_t, g, _ = SCENES[name]
    medium = OpticalProperties(NOMINAL, np.zeros(1), np.array([sigma_t]), np.array([g]), None)
    stack = flat_stacks(bench, sample, NOMINAL, medium)[0]
    alone = trace(stack, panels_setup(bench, stack.height), Effort(blocks=48), seed=5)
    unbounded = tallies.blocks_by_albedo(UNBOUNDED_STACK, ALBEDO)
    for channel, rho in RHO.items():
        blocks = tallies.blocks_by_albedo(channel, ALBEDO)
        mean, error = mean_and_error(blocks @ rho**tallies.bounce)
        other, other_error = alone.estimate(channel, ALBEDO, rho)
        assert np.all(np.abs(mean - other) < 4.0 * np.hypot(error, other_error))
        _, quiet = mean_and_error((blocks - unbounded) @ rho**tallies.bounce)
        assert np.all(quiet < 0.6 * error)


def test_an_unbounded_bench_with_wide_backgrounds_has_nothing_to_correct() -> None:
    """Without sides, with huge backgrounds, only the panels' finite distance differs."""
    wide = {"size_mm": (4000.0, 4000.0)}
    bench = BARE.model_copy(
        update={
            "size_mm": None,
            "background": BARE.background.model_copy(
                update={
                    "black": BARE.background.black.model_copy(update=wide),
                    "white": BARE.background.white.model_copy(update=wide),
                }
            ),
        }
    )
    medium = OpticalProperties(NOMINAL, np.zeros(1), np.array([5.0]), np.zeros(1), None)
    sample = Sample(name="s", thickness_mm=1.0, n=1.5)
    stack = flat_stacks(bench, sample, NOMINAL, medium)[0]
    effort = Effort(blocks=32, log2_paths=6, paired=True)
    tallies = trace(stack, panels_setup(bench, stack.height), effort, seed=2)
    for channel, rho in RHO.items():
        finite = tallies.blocks_by_albedo(channel, ALBEDO) @ rho**tallies.bounce
        unbounded = tallies.blocks_by_albedo(UNBOUNDED_STACK, ALBEDO) @ rho**tallies.bounce
        assert np.all(np.abs(finite.mean(axis=0) / unbounded.mean(axis=0) - 1.0) < 2e-3)


def test_what_a_paired_trace_cannot_tell_is_refused() -> None:
    bench, n, sigma_t, g, thickness = SCENES["bare"]
    medium = OpticalProperties(NOMINAL, np.zeros(1), np.array([sigma_t]), np.array([g]), None)
    sample = Sample(name="s", thickness_mm=thickness, n=n)
    stack = flat_stacks(bench, sample, NOMINAL, medium)[0]
    for effort in (Effort(paired=True, balance=True), Effort(paired=True, derivatives=True)):
        with pytest.raises(ValueError, match="paired"):
            trace(stack, panels_setup(bench, stack.height), effort)
