"""The documents build, and their internal links lead somewhere."""

from __future__ import annotations

from pathlib import Path

from tests.contract.repository import ROOT, run_python


def build(source: Path, target: Path) -> tuple[int, str]:
    """Parse all pages with every warning an error; nothing is rendered."""
    arguments = ("-b", "dummy", "-q", "-W", "--keep-going", str(source), str(target))
    done = run_python("-m", "sphinx", *arguments)
    return done.returncode, done.stdout + done.stderr


def test_the_documents_build_without_a_warning(tmp_path: Path):
    code, output = build(ROOT / "docs", tmp_path / "built")
    assert code == 0, output


def test_the_build_can_fail(tmp_path: Path):
    source = tmp_path / "docs"
    source.mkdir()
    (source / "conf.py").write_text('extensions = ["myst_parser"]\n', encoding="utf-8")
    page = "# Title\n\n```{toctree}\nmissing\n```\n"
    (source / "index.md").write_text(page, encoding="utf-8")
    code, output = build(source, tmp_path / "built")
    assert code != 0
    assert "missing" in output
