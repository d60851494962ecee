"""JAX as this engine needs it: 64-bit, and compiled programs kept between processes."""

from __future__ import annotations

import os

import jax

from twin.cache import cache_folder

WORTH_KEEPING_S = 0.2
"""Programs that compile faster than this [s] are not written to disk."""


def prepare_jax() -> None:
    """Turn on 64-bit numbers and JAX's persistent compilation cache.

    Called once, at import of this package. A cache folder that the user has chosen by
    `JAX_COMPILATION_CACHE_DIR` is kept; otherwise `twin.cache.cache_folder("jax")` is used.
    """
    settings: dict[str, object] = {"jax_enable_x64": True}
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        settings |= {
            "jax_compilation_cache_dir": str(cache_folder("jax")),
            "jax_persistent_cache_min_compile_time_secs": WORTH_KEEPING_S,
            "jax_persistent_cache_min_entry_size_bytes": -1,
        }
    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]
