"""Which program this is: a fingerprint of its source, so that results of another are not mixed."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path


@lru_cache(maxsize=16)
def code_of(*packages: str) -> str:
    """Fingerprint of the source of packages: a changed program computes its parts again."""
    digest = hashlib.sha256()
    for name in sorted(set(packages)):
        spec = find_spec(name)
        if spec is None:
            continue
        roots = [Path(place) for place in spec.submodule_search_locations or ()]
        files = [(file, file.relative_to(root)) for root in roots for file in root.rglob("*.py")]
        if spec.origin and not roots:
            files = [(Path(spec.origin), Path(Path(spec.origin).name))]
        for file, relative in sorted(files, key=lambda pair: pair[1].as_posix()):
            digest.update(f"{name}/{relative.as_posix()}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
