# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import threading

import pytest

from mnsf_ros.stream.latest_only_worker import LatestOnlyWorker

PATIENCE_S = 300.0


class GatedWork:
    """Work that waits at a gate in the middle of each job, and remembers what it did."""

    def __init__(self):
        self.started = []
        self.gate = threading.Semaphore(0)

    def __call__(self, job):
        self.started.append(job)
        assert self.gate.acquire(timeout=PATIENCE_S)

    def open_gate(self, num_jobs=1000):
        self.gate.release(num_jobs)


@pytest.fixture
def work():
    return GatedWork()


def test_job_that_an_idle_worker_has_not_begun_yet_is_not_replaced(work):
    """Of two jobs at once, the first one is on its way, and the second one waits."""
    threads_wait = threading.Lock()

    class Reluctant(LatestOnlyWorker):
        def _next_job(self):
            with threads_wait:
                return super()._next_job()

    with threads_wait:
        worker = Reluctant(work, "not scheduled yet")
        assert worker.submit("first") is False
        assert worker.submit("second") is False
        assert worker.submit("third") is True
        assert worker.load == 2
    work.open_gate()
    assert worker.close(PATIENCE_S)


def test_a_few_jobs_wait_in_order_and_then_only_the_newest(work, wait_until):
    worker = LatestOnlyWorker(work, "in order", num_in_order=2)
    assert [worker.submit(number) for number in range(6)] == 4 * [False] + 2 * [True]
    assert worker.load == 4
    work.open_gate(1)
    wait_until(lambda: work.started == [0, 1])
    # Nobody waits between 2 and 5: the place is for the newest until the line is empty.
    assert worker.submit(6) is True
    work.open_gate(2)
    wait_until(lambda: work.started == [0, 1, 2, 6])
    assert worker.submit(7) is False
    assert worker.forget() == 1
    work.open_gate()
    wait_until(lambda: worker.load == 0)
    assert worker.close(PATIENCE_S)
