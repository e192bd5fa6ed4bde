# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tasks one after the other, in processes of this machine, or on a Ray cluster.

Each parallel task is a `concurrent.futures.Future` of its events. On a cluster all machines need
this package, and the recordings at the same path.
"""

import logging
import multiprocessing
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.run_folder import StoppedError
from mnsf_ros.evaluation.task import TaskEvent, task_events

Events = Iterator[tuple[EvaluationTask, TaskEvent]]
Executor = Callable[[Sequence[EvaluationTask], EvaluationOptions], Events]
_TaskFuture = Future[list[TaskEvent]]

LOCAL: Final = "local"
_CONNECT_S: Final = 10.0
_ENDING_S: Final = 5.0


def run_serially(tasks: Sequence[EvaluationTask], options: EvaluationOptions) -> Events:
    """Runs tasks one after the other in this process."""
    for task in tasks:
        for event in task_events(task, options):
            yield task, event


def executor(
    num_workers: int = 1, ray_address: str | None = None, num_gpus: float | None = None
) -> AbstractContextManager[Executor]:
    """Returns the executor of tasks as a context.

    Args:
        num_workers: Processes on this machine.
        ray_address: Ray cluster to run on instead; `local` starts one on this machine.
        num_gpus: GPU share of each task on the cluster; None: 1 if methods use CUDA, else 0.

    Raises:
        EvaluationError: A number is out of range, or combined with a cluster; on entering the
            context, the cluster cannot be reached.
    """
    if num_workers < 1:
        raise EvaluationError(f"workers: got {num_workers}, expected 1 or more")
    if num_gpus is not None and num_gpus < 0:
        raise EvaluationError(f"num_gpus: got {num_gpus}, expected 0 or more")
    if ray_address is not None:
        if num_workers > 1:
            raise EvaluationError("--workers cannot be combined with --ray")
        import ray

        return _ray_cluster(ray, ray_address, num_gpus)
    return _processes(num_workers) if num_workers > 1 else nullcontext(run_serially)


def _events_as_tasks_end(
    futures: dict[_TaskFuture, EvaluationTask], lost: type[Exception]
) -> Events:
    """Yields the events of finished tasks, then raises a StoppedError if workers were `lost`."""
    reason: Exception | None = None
    for future in as_completed(futures):
        try:
            events = future.result()
        except lost as error:
            reason = error
            continue
        for event in events:
            yield futures[future], event
    if reason is not None:
        lines = str(reason).strip().splitlines() or [type(reason).__name__]
        raise StoppedError(f"a worker was lost, for example for lack of memory ({lines[0]})")


@contextmanager
def _processes(num_workers: int) -> Iterator[Executor]:
    # Not fork: torch and CUDA do not survive it.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(num_workers, context, _end_with_parent)

    def execute(tasks: Sequence[EvaluationTask], options: EvaluationOptions) -> Events:
        # Ctrl-C reaches all processes of a terminal; workers inherit that they ignore it.
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            futures = {pool.submit(_events_in_process, task, options): task for task in tasks}
        finally:
            signal.signal(signal.SIGINT, handler)
        yield from _events_as_tasks_end(futures, BrokenProcessPool)

    others = set(multiprocessing.active_children())
    try:
        yield execute
    finally:
        workers = set(multiprocessing.active_children()) - others
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.join(_ENDING_S)
            worker.kill()
        # Without waiting, Python would warn of leaked semaphores after an interruption.
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Ends this worker when its parent is gone, also after SIGKILL."""

    def wait() -> None:
        if (parent := multiprocessing.parent_process()) is not None:
            parent.join()
            signal.raise_signal(signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def _events_in_process(task: EvaluationTask, options: EvaluationOptions) -> list[TaskEvent]:
    """Returns the events of a task; SIGTERM ends the programs it started, then this process."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return _all_events(task, options)
    except KeyboardInterrupt:
        # Otherwise the pool would start another task.
        signal.raise_signal(signal.SIGKILL)
        raise
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _all_events(task: EvaluationTask, options: EvaluationOptions) -> list[TaskEvent]:
    return list(task_events(task, options))


@contextmanager
def _ray_cluster(ray: Any, address: str, num_gpus: float | None) -> Iterator[Executor]:  # noqa: ANN401
    def execute(tasks: Sequence[EvaluationTask], options: EvaluationOptions) -> Events:
        compute = options.settings.compute
        share = float(compute.device == "cuda") if num_gpus is None else num_gpus
        needs = {"CPU": compute.num_threads, "GPU": share}
        _check_nodes([node["Resources"] for node in ray.nodes() if node["Alive"]], needs)
        # A task whose worker or node is lost is tried again by Ray.
        work = ray.remote(num_cpus=needs["CPU"], num_gpus=share)(_all_events)
        futures = {work.remote(task, options).future(): task for task in tasks}
        yield from _events_as_tasks_end(futures, ray.exceptions.RayError)

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # A cluster for this machine only need not be reached from others.
    local = {"_node_ip_address": "127.0.0.1"} if address == LOCAL else {}
    try:
        _check_address(address)
        ray.init(
            address=address,
            include_dashboard=False if local else None,
            log_to_driver=False,
            logging_level=logging.ERROR,
            **local,
        )
    except (OSError, ValueError, RuntimeError) as error:
        text = " ".join(str(error).split())[:200]
        raise EvaluationError(f"no Ray cluster at {address!r}: {text}") from error
    try:
        yield execute
    finally:
        ray.shutdown()


def _check_nodes(nodes: Sequence[dict[str, float]], needs: dict[str, float]) -> None:
    """Refuses tasks that no node has the resources for: they would wait forever."""
    if not any(all(node.get(key, 0.0) >= needs[key] for key in needs) for node in nodes):
        listed = ", ".join(f"{value:g} {key}" for key, value in needs.items())
        raise EvaluationError(f"no node of the Ray cluster has what a task needs: {listed}")


def _check_address(address: str) -> None:
    """Raises OSError if nobody listens there: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
