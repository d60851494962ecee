"""The default scenario's explorer, built once for all tests of the page."""

from __future__ import annotations

import pytest

from scenarios.explore.model import Explorer
from scenarios.explore.source import source_of


@pytest.fixture(scope="session")
def explorer() -> Explorer:
    return Explorer(source_of(None))
