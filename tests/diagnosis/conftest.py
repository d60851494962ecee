from __future__ import annotations

import pytest

from tests.diagnosis.core_toy import LinearToy, Toy


@pytest.fixture(scope="session")
def toy() -> Toy:
    return Toy()


@pytest.fixture(scope="session")
def linear_toy(toy: Toy) -> LinearToy:
    return LinearToy(toy)
