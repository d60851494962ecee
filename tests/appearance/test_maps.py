"""Appearance maps: right values, one key for one content, and a cache that loses nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin import Bench, InputError, MapGrid, OpticalProperties, Sample, appearance_map
from twin.appearance import map_key
from twin.bench import Background, Backgrounds
from twin.transport import captures

GRID = MapGrid(albedo=(0.0, 0.5, 0.9), sigma_t_per_mm=(0.5, 2.0), g=(0.0, 0.6))
BENCH = Bench(covers_above=(), covers_below=())


def small(folder: Path, **options: object):
    return appearance_map(BENCH, 0.5, 1.5, grid=GRID, paths=2048, folder=folder, **options)


def test_a_map_agrees_with_captures_at_its_nodes(tmp_path: Path) -> None:
    found = small(tmp_path)
    sample = Sample(name="s", thickness_mm=0.5, n=1.5)
    where = np.array([550.0])
    for g_index, agrees in ((1, True), (0, False)):  # the control: another g does not agree
        medium = OpticalProperties(
            where, np.array([0.9]), np.array([2.0]), np.array([GRID.g[g_index]]), None
        )
        direct = captures(BENCH, sample, where, properties=medium, paths=16384, seed=4)
        rho = (float(direct.rho_black[0]), float(direct.rho_white[0]))
        black, white, collimated = found.intensities(*rho)[2, 1, 1]
        z = np.array(
            [
                (black - direct.black[0]) / np.hypot(found.black_se[2, 1, 1], direct.black_se[0]),
                (white - direct.white[0]) / np.hypot(found.white_se[2, 1, 1], direct.white_se[0]),
            ]
        )
        assert bool(np.all(np.abs(z) < 4.5)) is agrees
    assert abs(collimated - direct.collimated[0]) < 1e-3


def test_any_reflectance_comes_from_one_map(tmp_path: Path) -> None:
    """The power series at 0.5 against a bench whose white reflects 0.5."""
    found = small(tmp_path)
    grey = BENCH.model_copy(update={"background": Backgrounds(white=Background(reflectance=0.5))})
    sample = Sample(name="s", thickness_mm=0.5, n=1.5)
    where = np.array([550.0])
    medium = OpticalProperties(where, np.array([0.5]), np.array([0.5]), np.array([0.6]), None)
    direct = captures(grey, sample, where, properties=medium, paths=16384, seed=8)
    white = found.intensities(0.02, 0.5)[1, 0, 1, 1]
    assert abs(white - direct.white[0]) < 4.5 * np.hypot(
        found.white_se[1, 0, 1], direct.white_se[0]
    )
    assert abs(found.intensities(0.02, 0.7)[1, 0, 1, 1] - direct.white[0]) > 0.02


def test_the_second_call_reads_the_cache(tmp_path: Path) -> None:
    calls: list[int] = []
    first = small(tmp_path, progress=lambda done, total: calls.append(done))
    assert calls
    assert max(calls) == 4
    calls.clear()
    again = small(tmp_path, progress=lambda done, total: calls.append(done))
    assert calls == []
    assert np.array_equal(first.black_series, again.black_series)
    assert [path.suffix for path in tmp_path.iterdir()] == [".map"]


@pytest.mark.parametrize("damage", ["flip", "cut", "foreign"])
def test_a_damaged_file_is_said_and_computed_again(tmp_path: Path, damage: str) -> None:
    first = small(tmp_path)
    path = next(tmp_path.glob("*.map"))
    data = path.read_bytes()
    broken = {
        "flip": data[:-50] + bytes([data[-50] ^ 1]) + data[-49:],
        "cut": data[: len(data) // 2],
        "foreign": b"not a map at all",
    }[damage]
    path.write_bytes(broken)
    said: list[str] = []
    again = small(tmp_path, say=said.append)
    assert len(said) == 1
    assert path.name in said[0]
    assert np.array_equal(first.white_series, again.white_series)
    assert path.read_bytes() == data


def test_an_interrupted_map_resumes_with_the_next_g(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        small(tmp_path, progress=interrupt)
    assert [path.suffix for path in tmp_path.iterdir()] == [".part"]
    steps: list[int] = []
    resumed = small(tmp_path, progress=lambda done, total: steps.append(done))
    assert steps[0] == 2  # the first g was kept
    whole = small(tmp_path / "other")
    assert np.array_equal(resumed.black_series, whole.black_series)


def test_the_number_of_threads_changes_nothing(tmp_path: Path) -> None:
    one = small(tmp_path / "one", threads=1)
    two = small(tmp_path / "two", threads=2)
    for name in ("black_series", "white_series", "collimated", "black_se"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_the_key_follows_what_matters_and_nothing_else() -> None:
    def key(bench: Bench = BENCH, thickness: float = 0.5, n: float = 1.5, seed: int = 0) -> str:
        return map_key(bench, thickness, n, GRID, 1024, seed)

    other_lamp = BENCH.model_copy(update={"panel_spectrum": "D65"})
    wider = BENCH.model_copy(update={"size_mm": (50.0, 50.0)})
    assert key() == key(other_lamp)
    assert len({key(), key(wider), key(thickness=0.6), key(n=1.4), key(seed=1)}) == 5


def test_refining_keeps_the_nodes(tmp_path: Path) -> None:
    found = small(tmp_path)
    finer = found.refined(2, 3)
    assert finer.shape == (3, 3, 4)
    np.testing.assert_allclose(
        finer.intensities(0.02, 0.99)[:, ::2, ::3], found.intensities(0.02, 0.99), rtol=1e-5
    )


def test_what_cannot_be_computed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="thickness"):
        appearance_map(BENCH, 0.0, 1.5, grid=GRID, folder=tmp_path)
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="file"):
        small(blocked / "maps")


@pytest.mark.parametrize(
    ("axis", "values"),
    [
        ("albedo", (0.0, 1.1)),
        ("albedo", (0.5, 0.4)),
        ("sigma_t_per_mm", (0.0, 1.0)),
        ("g", (0.0, 1.0)),
    ],
)
def test_a_grid_outside_physics_is_refused(axis: str, values: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="found"):
        MapGrid.model_validate({**GRID.model_dump(), axis: values})
