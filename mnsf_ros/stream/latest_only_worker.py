# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One thread with a last waiting slot: a newer job takes the place of the one that waits there."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

_LOG = logging.getLogger(__name__)

Job = TypeVar("Job")


class LatestOnlyQueue(Generic[Job]):
    """Jobs that wait: a few in their order, then only the newest. Not for several threads at once.

    The few are for work that is cheaper if none is left out. Once they are so many, all newer ones
    share one more place, until none of them waits any more.
    """

    def __init__(self, num_in_order: int = 0) -> None:
        self._num_in_order = num_in_order
        self._in_order: deque[Job] = deque()
        self._newest: Job | None = None

    def __len__(self) -> int:
        return len(self._in_order) + int(self._newest is not None)

    def put(self, job: Job) -> Job | None:
        """Adds a job. Returns the one whose place it took, if any."""
        if self._newest is None and len(self._in_order) < self._num_in_order:
            self._in_order.append(job)
            return None
        dropped, self._newest = self._newest, job
        return dropped

    def take(self) -> Job | None:
        """Removes and returns the job whose turn it is; None if none waits."""
        if self._in_order:
            return self._in_order.popleft()
        job, self._newest = self._newest, None
        return job

    def clear(self) -> int:
        """Forgets all jobs, and returns how many there were."""
        number = len(self)
        self._in_order.clear()
        self._newest = None
        return number


class LatestOnlyWorker(Generic[Job]):
    """Runs jobs one at a time, then the newest, so that slow jobs never make a long queue."""

    def __init__(self, work: Callable[[Job], None], name: str, num_in_order: int = 0) -> None:
        """Starts the thread, which calls `work` with each job; `num_in_order` wait in order.

        An error that it raises is logged, and the next job is worked on all the same.
        """
        self._work = work
        # Guards the three fields below it.
        self._condition = threading.Condition()
        # Being worked on, or about to be: a newer job takes the place of one that waits only.
        self._current: Job | None = None
        self._waiting: LatestOnlyQueue[Job] = LatestOnlyQueue(num_in_order)
        self._is_closing = False
        # A daemon, because a job deep in a library cannot be interrupted at the end of a process.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def load(self) -> int:
        """Jobs at hand: 0 idle, 1 working, 2 working with one waiting and so on."""
        with self._condition:
            return int(self._current is not None) + len(self._waiting)

    @property
    def is_closing(self) -> bool:
        """True once `close` was called; a long job should look at it and give up."""
        with self._condition:
            return self._is_closing

    def submit(self, job: Job) -> bool:
        """Lets a job wait for its turn; True if it took the place of another. Never blocks.

        After `close` the job is forgotten at once.
        """
        with self._condition:
            if self._is_closing:
                return False
            if self._current is None:
                self._current = job
                self._condition.notify()
                return False
            return self._waiting.put(job) is not None

    def forget(self) -> int:
        """Forgets the jobs that wait, and returns how many there were."""
        with self._condition:
            return self._waiting.clear()

    def close(self, timeout_s: float) -> bool:
        """Forgets the waiting jobs and waits for the running one; False if that goes on."""
        with self._condition:
            self._is_closing = True
            self._waiting.clear()
            self._condition.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (job := self._next_job()) is not None:
            try:
                self._work(job)
            except Exception:  # noqa: BLE001 - one bad job must not end the thread
                _LOG.exception("a job failed in thread %s", self._thread.name)
            finally:
                with self._condition:
                    self._current = self._waiting.take()

    def _next_job(self) -> Job | None:
        with self._condition:
            while self._current is None and not self._is_closing:
                self._condition.wait()
            if self._is_closing:
                self._current = None
            return self._current
