"""The compiled programs of a network's training: losses, their slopes, Adam, the estimate."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import fields
from itertools import pairwise
from typing import Any

import numpy as np

from estimators.fluorescence.cells import Cells
from estimators.fluorescence.learned_network import (
    DIAGONAL,
    FAINT,
    Fixed,
    Single,
    first_look,
    hidden,
    products,
    second_look,
    swish,
)

Program = Callable[..., Any]

SHARES = 4
"""Parts of a step that may be computed side by side."""
FIRST = 0.3
"""Weight of the first look in the loss."""
LEVELS = (0.05, 0.95)
ONE_THREAD: dict[str, str | bool] = {
    "xla_cpu_multi_thread_eigen": False,
    "xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_DOT",
}
"""Options of XLA: a part of a step is computed by one thread, its products by YNNPACK."""


def programs(
    known: Fixed, design: Single, cells: Cells, batch: int, pool: Executor
) -> tuple[Program, Program, Program]:
    """Compiled: a step for the mean, a step for the quantiles, the estimate inside its bounds.

    A step is computed in parts of a fixed size, each by one thread, with products by YNNPACK and
    sums by XLA's own code: by anything else, or in one part, bytes depend on the number of cores.

    Args:
        known: what the network has before its training.
        design: captures of the unknowns, (M, N).
        cells: the unknowns.
        batch: materials of a step.
        pool: computes the parts of a step.

    Returns:
        Two functions (state, captures, unknowns, rate) -> state, where a state is weights, mean and
        mean square of their slopes (Adam), and steps taken; one (weights, captures) -> (estimate,
        scale), each (B, N).
    """
    from twin.adding_doubling.runtime import prepare_jax

    prepare_jax()
    import jax
    import jax.numpy as jnp

    on_device: Any = {each.name: jnp.asarray(getattr(known, each.name)) for each in fields(Fixed)}
    fixed = Fixed(**on_device)
    seen_by, single = jnp.asarray(design.T), jnp.float32
    row, column = np.nonzero(cells.below_diagonal)
    count = row.size

    def inside(x: Any) -> Any:
        return jnp.maximum(x, single(0.0)).at[:, count:].min(single(1.0))

    def looks(p: Any, value: Any) -> tuple[Any, Any, Any, Any]:
        """Both estimates (B, N), scale of the corrections (B, N), last layer."""
        base, size, seen = first_look(fixed, count, value, jnp)
        scale = jnp.where(
            jnp.arange(base.shape[1]) < count, size * jnp.ones_like(base), single(DIAGONAL)
        )
        h = hidden(p, seen, jnp)
        first = base + scale * (h @ p["first"][0] + p["first"][1])
        first = first.at[:, :count].add(size * products(p, h, cells, jnp)[:, row, column])
        within = inside(first)
        white = (value - within @ seen_by) @ fixed.white
        again = second_look(white, size, h, jnp)
        h = swish(again @ p["second"][0] + p["second"][1], jnp)
        return first, within + scale * (h @ p["last"][0] + p["last"][1]), scale, h

    def estimate(p: Any, value: Any) -> tuple[Any, Any]:
        _, found, scale, _ = looks(p, value)
        return inside(found), scale

    def of_one(x: Any, target: Any) -> Any:
        error = (x - target) ** 2
        size = (target[:, :count] ** 2).mean(axis=1) + single(FAINT**2)
        cells_lost = jnp.log(single(1e-3) + error[:, :count].mean(axis=1) / size).sum()
        reflected = jnp.log(single(1e-4) + error[:, count:].mean(axis=1)).sum()
        return (cells_lost + single(DIAGONAL) * reflected) / single(batch)

    def mean_loss(p: Any, value: Any, target: Any) -> Any:
        first, last, _, _ = looks(p, value)
        return of_one(last, target) + single(FIRST) * of_one(first, target)

    def spread_loss(p: Any, value: Any, target: Any) -> Any:
        _, found, scale, h = jax.lax.stop_gradient(looks(p, value))
        wrong = (target - inside(found)) / scale
        wide = jax.nn.softplus(h @ p["spread"][0] + p["spread"][1])
        low, high = -wide[:, : target.shape[1]], wide[:, target.shape[1] :]
        loss = single(0.0)
        for level, edge in zip(LEVELS, (low, high), strict=True):
            beyond = wrong - edge
            loss += jnp.maximum(single(level) * beyond, single(level - 1.0) * beyond).sum()
        return loss / single(batch * design.shape[1])

    one_thread = _known_options()

    def step_of(loss: Any) -> Callable[..., Any]:
        slope = jax.jit(jax.grad(loss), compiler_options=one_thread)

        def part(p: Any, value: Single, target: Single) -> Any:
            return jax.block_until_ready(slope(p, value, target))  # type: ignore[no-untyped-call]

        def moved(state: Any, slopes: Any, rate: Any) -> Any:
            p, mean, square, time = state
            g, time = jax.tree.map(lambda *each: sum(each), *slopes), time + single(1.0)
            a, b = single(0.9), single(0.99)
            mean = jax.tree.map(lambda m, d: a * m + (1 - a) * d, mean, g)
            square = jax.tree.map(lambda s, d: b * s + (1 - b) * d * d, square, g)

            def new(q: Any, m: Any, s: Any) -> Any:
                root = jnp.sqrt(s / (1 - b**time)) + single(1e-8)
                return q - rate * (m / (1 - a**time)) / root

            return jax.tree.map(new, p, mean, square), mean, square, time

        update = jax.jit(moved, compiler_options=one_thread)

        def step(state: Any, value: Single, target: Single, rate: Any) -> Any:
            cut = [len(value) * k // SHARES for k in range(SHARES + 1)]
            jobs = [pool.submit(part, state[0], value[a:b], target[a:b]) for a, b in pairwise(cut)]
            return update(state, [job.result() for job in jobs], rate)

        return step

    return step_of(mean_loss), step_of(spread_loss), jax.jit(estimate, compiler_options=one_thread)


def _known_options() -> dict[str, str | bool]:
    """Those of `ONE_THREAD` that the installed XLA knows: they are not part of its interface."""
    import jax

    known: dict[str, str | bool] = {}
    for name, value in ONE_THREAD.items():
        try:
            jax.jit(lambda x: x + 1.0, compiler_options={name: value})(np.float32(0.0))
        except jax.errors.JaxRuntimeError:
            continue
        known[name] = value
    return known
