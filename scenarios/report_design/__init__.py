"""The report of a design study: one offline HTML file."""

from __future__ import annotations

from scenarios.report_design.page import design_page

__all__ = ["design_page"]
