"""What every test shares: one hypothesis profile, and the way to the reference data."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# As the command does: two processes test at once, and their linear algebra need not fight over the
# cores. Said before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell ignores Ctrl-C in what it starts in the background, and so would all that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent

settings.register_profile(
    "benchtwin",
    derandomize=True,
    deadline=None,
    max_examples=50,
    print_blob=False,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("benchtwin")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of reference data beside the repository; without it the test is skipped."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the reference data are not here: no folder ../shared/data beside the checkout")
    return folder
