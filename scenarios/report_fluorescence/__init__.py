"""The report of a fluorescence estimate: one offline HTML file with inline SVG."""

from __future__ import annotations

from scenarios.report_fluorescence.page import fluorescence_page, write_fluorescence_report

__all__ = ["fluorescence_page", "write_fluorescence_report"]
