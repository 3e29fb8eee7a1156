"""Shared test settings."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from flexarm.console import progress

# The first example of a property may compile a model, so examples have no time limit.
settings.register_profile("flexarm", deadline=None, max_examples=30, derandomize=True)
settings.load_profile("flexarm")

# What commands write does not depend on how long they take here.
progress.EVERY = 1e9


# A run in the background of a shell script is started with interrupts ignored, and tests of them would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def cluster() -> Iterator[Any]:
    """The address of a dask cluster of two processes on this machine."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as made:
        yield made.scheduler_address
