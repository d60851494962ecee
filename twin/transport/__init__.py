"""Light transport: the Monte Carlo of the whole bench, in NVIDIA Warp.

`captures` simulates the noiseless captures of a sample; `trace` is the engine below it, for
any layered stack (`FlatStack`) in any set-up (`Setup`).
"""

from twin.transport.bench_captures import NoiselessCaptures, captures, flat_stacks
from twin.transport.engine import (
    Effort,
    Outline,
    PanelShape,
    Setup,
    Tallies,
    compile_kernels,
    mean_and_error,
    run_many,
    trace,
)
from twin.transport.geometry import beam_setup, panels_setup, reference_factor
from twin.transport.responses import capture_blocks, response
from twin.transport.tables import FlatStack, stack_transfer

__all__ = [
    "Effort",
    "FlatStack",
    "NoiselessCaptures",
    "Outline",
    "PanelShape",
    "Setup",
    "Tallies",
    "beam_setup",
    "capture_blocks",
    "captures",
    "compile_kernels",
    "flat_stacks",
    "mean_and_error",
    "panels_setup",
    "reference_factor",
    "response",
    "run_many",
    "stack_transfer",
    "trace",
]
