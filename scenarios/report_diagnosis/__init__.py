"""The report of a diagnosis: one offline HTML file, and the same in words and numbers."""

from __future__ import annotations

from scenarios.report_diagnosis.page import diagnosis_page
from scenarios.report_diagnosis.words import Named, as_json, headline, terminal

__all__ = ["Named", "as_json", "diagnosis_page", "headline", "terminal"]
