"""Jobs in processes: results in order, errors told, nobody left behind."""

from __future__ import annotations

import multiprocessing
import operator

import pytest

from carlaloc_env.core.errors import CarlaLocError
from recorder.generation.worker_processes import run_jobs


def _ignore(number: int, done: float) -> None:
    pass


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_jobs(workers: int) -> None:
    """`is_not(job, tell)` is true of every job, in this process and in others."""
    assert run_jobs(operator.is_not, [3, 1, 2], workers, _ignore) == [True, True, True]


def test_a_job_that_fails_ends_them_all() -> None:
    """Adding a function to a number fails in the worker; the parent says so and leaves no process."""
    with pytest.raises(CarlaLocError, match="ended early"):
        run_jobs(operator.add, [3, 1, 2], 2, _ignore)
    assert not multiprocessing.active_children()
