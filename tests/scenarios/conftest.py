"""One finished run of the tiny scenario, shared by the tests of this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.scenarios.tiny import answer, call, tiny, write


class Run(NamedTuple):
    """A finished run."""

    scenario: Path
    folder: Path
    cache: Path
    answer: dict[str, Any]


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    base = tmp_path_factory.mktemp("run")
    scenario = write(base / "tiny.toml", tiny())
    folder, cache = base / "out", base / "cache"
    result = call("run", scenario, "--out", folder, "--cache", cache, "--json")
    return Run(scenario, folder, cache, answer(result))
