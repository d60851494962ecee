"""The second forward engine: adding-doubling of plane-parallel stacks, in JAX, 64-bit.

`captures` has the interface of the Monte Carlo in `twin.transport`; `captures_model` builds a
differentiable model of a bench once, to be evaluated thousands of times; `slab_optics` answers
for slabs in general (UR1, UT1, URU, UTU, directions, cones). Importing this package imports JAX.
"""

from __future__ import annotations

from twin.adding_doubling.runtime import prepare_jax

prepare_jax()

from twin.adding_doubling.captures import STATED_BOUND, captures  # noqa: E402
from twin.adding_doubling.model import CapturesModel, captures_model  # noqa: E402
from twin.adding_doubling.program import parts_of, value_and_slopes  # noqa: E402
from twin.adding_doubling.slab import SlabOptics, slab_optics  # noqa: E402
from twin.adding_doubling.streams import Streams, make_streams  # noqa: E402
from twin.adding_doubling.terms import (  # noqa: E402
    Constants,
    Form,
    ObliqueBeam,
    Parameters,
    Parts,
)

__all__ = [
    "STATED_BOUND",
    "CapturesModel",
    "Constants",
    "Form",
    "ObliqueBeam",
    "Parameters",
    "Parts",
    "SlabOptics",
    "Streams",
    "captures",
    "captures_model",
    "make_streams",
    "parts_of",
    "slab_optics",
    "value_and_slopes",
]
