"""The engine with a memory answers as the one without."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.kept import KeptEngine
from tests.effects.worlds import WAVELENGTH, candidates, engine, material, world

PLANE = sorted(name for name, each in candidates().items() if each.engine == "plane")


@pytest.mark.parametrize("name", PLANE)
def test_worlds_are_not_taken_for_others_that_were_seen_before(name: str) -> None:
    kept = KeptEngine(world(), WAVELENGTH)
    before = kept.light(world(), material())
    own = candidates()[name]
    values = [p.nominal + (-1.0 if p.sign == "negative" else 1.0) * p.prior_scale
              for p in own.parameters]  # fmt: skip
    changed = own.apply(world(), values)
    after = kept.light(changed, material())
    assert np.array_equal(after, engine().light(changed, material()))
    assert np.array_equal(kept.light(world(), material()), before)
    if not own.name.startswith(("wavelength", "bandwidth")):
        assert not np.array_equal(after, before), "an effect on the light that changes nothing"
