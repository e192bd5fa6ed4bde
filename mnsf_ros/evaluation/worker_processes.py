"""Tasks side by side on this machine, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Final

from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.runner import Ended, TaskEvent, dispatched, task_events

_DYING_S: Final = 5.0
# torch imports the second one when the first optimizer is made.
_SLOW_IMPORTS: Final = (task_events.__module__, "torch._dynamo")


class WorkerProcesses:
    """Runs tasks in processes; one that dies is replaced. An Executor."""

    def __init__(self, num_workers: int) -> None:
        """Says how many processes there are at a time."""
        self._num_workers = num_workers

    def __call__(
        self, tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready."""
        processes = _Processes()
        try:
            yield from dispatched(tasks, options, processes, self._num_workers)
        finally:
            processes.stop_all()


class _Processes:
    """Workers, each known by the end of a pipe from which its events come."""

    def __init__(self) -> None:
        self._processes: dict[Connection, BaseProcess] = {}

    def start(self, task: EvaluationTask, options: EvaluationOptions) -> Connection:
        # Not fork: torch and CUDA do not survive it. The server has imported all that is slow,
        # and done nothing else, so that its children begin at once.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_SLOW_IMPORTS))
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(sender, task, options), daemon=True)
        process.start()
        # The end of the pipe is seen only when nobody else could write to it.
        sender.close()
        self._processes[receiver] = process
        return receiver

    def events(self, handles: list[Connection]) -> Iterator[tuple[Connection, TaskEvent | Ended]]:
        ready = wait(handles)
        for pipe in (pipe for pipe in handles if pipe in ready):
            try:
                yield pipe, pipe.recv()
            except (EOFError, OSError):
                process = self._processes[pipe]
                # What dies by itself has a status to be told.
                process.join(timeout=_DYING_S)
                self._stop(pipe)
                yield pipe, Ended(f"its process ended with status {process.exitcode}")

    def stop_all(self) -> None:
        """Ends the processes that still run."""
        for pipe in list(self._processes):
            self._stop(pipe)

    def _stop(self, pipe: Connection) -> None:
        process = self._processes.pop(pipe)
        pipe.close()
        if process.is_alive():
            process.terminate()
            process.join(timeout=_DYING_S)
        if process.is_alive():
            process.kill()
        process.join()


def _work(events: Connection, task: EvaluationTask, options: EvaluationOptions) -> None:
    # Ctrl-C goes to all processes of the terminal; the parent ends this one when it is time, and
    # then what is half written is to be taken away.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for event in task_events(task, options):
            events.send(event)
    except (BrokenPipeError, KeyboardInterrupt):
        return
    finally:
        events.close()
