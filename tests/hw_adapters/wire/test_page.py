"""The examples of docs/instruments.md run as they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("usb", reason="pyusb is not installed (extra instruments)")
pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

PAGE = Path(__file__).parents[3] / "docs" / "instruments.md"


def test_the_examples_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 2
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # noqa: S102
    said = capsys.readouterr().out
    assert "spectrometer USB650 USB650-1 through seabreeze" in said
    assert "lights LED-SUPPLY TWIN0001 through PyVISA" in said
    assert names["measurement"].captures.counts.shape == (60, 310)
