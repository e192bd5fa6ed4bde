"""One thread with one waiting slot: a newer job takes the place of the one that waits."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

_LOG = logging.getLogger(__name__)

Job = TypeVar("Job")


class LatestOnlyWorker(Generic[Job]):
    """Runs jobs one at a time, always the newest, so that a slow job never makes a queue."""

    def __init__(self, work: Callable[[Job], None], name: str) -> None:
        """Starts the thread, which calls `work` with each job.

        An error that it raises is logged, and the next job is worked on all the same.
        """
        self._work = work
        # Guards the three fields below it.
        self._condition = threading.Condition()
        # Being worked on, or about to be: a newer job takes the place of one that waits only.
        self._current: Job | None = None
        self._waiting: Job | None = None
        self._is_closing = False
        # A daemon, because a job deep in a library cannot be interrupted at the end of a process.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def load(self) -> int:
        """Jobs at hand: 0 idle, 1 working, 2 working with one waiting."""
        with self._condition:
            return int(self._current is not None) + int(self._waiting is not None)

    @property
    def is_closing(self) -> bool:
        """True once `close` was called; a long job should look at it and give up."""
        with self._condition:
            return self._is_closing

    def submit(self, job: Job) -> bool:
        """Puts a job in the waiting slot; True if it took the place of another. Never blocks.

        After `close` the job is forgotten at once.
        """
        with self._condition:
            if self._is_closing:
                return False
            if self._current is None:
                self._current = job
                self._condition.notify()
                return False
            has_replaced = self._waiting is not None
            self._waiting = job
        return has_replaced

    def forget(self) -> bool:
        """Empties the waiting slot; True if there was a job in it."""
        with self._condition:
            had_job, self._waiting = self._waiting is not None, None
        return had_job

    def close(self, timeout_s: float) -> bool:
        """Forgets the waiting job and waits for the running one; False if that goes on."""
        with self._condition:
            self._is_closing = True
            self._waiting = None
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
                    self._current, self._waiting = self._waiting, None

    def _next_job(self) -> Job | None:
        """Waits for a job; None at the end."""
        with self._condition:
            while self._current is None and not self._is_closing:
                self._condition.wait()
            if self._is_closing:
                self._current = None
            return self._current
