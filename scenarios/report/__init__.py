"""The report: one offline HTML file that a person wants to look at.

`write_report` takes a measurement and a result and writes the file; nothing is fetched, nothing
runs, and the same input gives the same bytes.
"""

from __future__ import annotations

from scenarios.report.build import write_report

__all__ = ["write_report"]
