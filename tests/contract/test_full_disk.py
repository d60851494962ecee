"""A disk that fills up while a file is written: one message, and the old file stays."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from twin.errors import InputError
from twin.files import write_atomically


def test_the_old_file_stays_and_nothing_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_atomically(tmp_path / "report.html", b"old")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"report\.html.*No space left.*with space left"):
            write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["report.html"]
    assert write_atomically(path, b"new").read_bytes() == b"new"
