"""`python -m scenarios.cli` is the command `benchtwin`."""

from __future__ import annotations

from scenarios.cli import main

if __name__ == "__main__":
    main()
