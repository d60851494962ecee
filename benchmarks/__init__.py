"""Benchmarks: one module each, with `run(quick: bool) -> dict`.

`python -m benchmarks --list` names them; a measured figure in a document names its command.
"""
