# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tasks on a Ray cluster: one Ray task per recording and method.

The recordings must be at the same path on all machines, and this package installed there. Ray
itself is an extra: `pip install '.[ray]'`.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.executors import Ended, dispatched
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.task import TaskEvent, TaskFailed, task_events


class Mailbox:
    """Where workers post their events; it lives beside the driver and is lost only with it."""

    def __init__(self) -> None:
        self._posts: list[tuple[int, TaskEvent]] = []

    def post(self, number: int, event: TaskEvent) -> None:
        """Takes an event of a worker."""
        self._posts.append((number, event))

    def empty(self) -> list[tuple[int, TaskEvent]]:
        """Gives out all events since the last time."""
        posts, self._posts = self._posts, []
        return posts


def post_events(
    mailbox: Any,  # noqa: ANN401 - a handle of an actor
    number: int,
    task: EvaluationTask,
    options: EvaluationOptions,
) -> None:
    """Runs a task and posts its events. Runs on the cluster."""
    import ray

    for event in task_events(task, options):
        # Waits until it is there, so that nothing is on its way when the task ends.
        ray.get(mailbox.post.remote(number, event))


def start_mailbox(ray: Any) -> Any:  # noqa: ANN401 - Ray is optional, so its types are
    """Starts a mailbox on the node of the driver; returns the handle of the actor."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    # Nowhere else, not even for a moment: another node may be lost.
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    return ray.remote(num_cpus=0, scheduling_strategy=here)(Mailbox).remote()


LOCAL: Final = "local"
_POLL_S: Final = 0.2
_CONNECT_S: Final = 10.0
_NO_RAY: Final = "--ray needs Ray; in the checkout: pip install '.[ray]'"


class RayCluster:
    """Runs tasks on a Ray cluster; one whose worker or node is lost is tried again. An Executor."""

    def __init__(self, address: str, *, num_gpus: float = 0.0) -> None:
        """Names the cluster: `local` starts one on this machine.

        A task takes `num_gpus`, which may be a part of one.

        Raises:
            EvaluationError: Ray is not installed, or the number of GPUs is below 0.
        """
        if num_gpus < 0:
            raise EvaluationError(f"num_gpus: got {num_gpus}, expected 0 or more")
        self._ray = _imported_ray()
        self._address = address
        self._num_gpus = num_gpus

    def __call__(
        self, tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready.

        Raises:
            EvaluationError: There is no such cluster, or no node of it can run a task.
        """
        with self._connected():
            num_cpus = options.settings.compute.num_threads
            self._check_nodes(num_cpus)
            # Ray would try again by itself, but then nobody would know which rows are there.
            needs = {"num_cpus": num_cpus, "num_gpus": self._num_gpus, "max_retries": 0}
            work = self._ray.remote(**needs)(post_events)
            workers = _RayWorkers(self._ray, work, start_mailbox(self._ray))
            left = {task.key: task for task in tasks}
            try:
                for task, event in dispatched(tasks, options, workers):
                    if isinstance(event, (Findings, TaskFailed)):
                        del left[task.key]
                    yield task, event
            except self._ray.exceptions.RayError as error:
                for task in left.values():
                    yield task, TaskFailed(f"the Ray cluster is lost: {_first_line(error)}")

    @contextmanager
    def _connected(self) -> Iterator[None]:
        if self._ray.is_initialized():
            yield
            return
        # A cluster for this machine only need not be reached from others.
        local = {"_node_ip_address": "127.0.0.1"} if self._address == LOCAL else {}
        try:
            _check_address(self._address)
            self._ray.init(
                address=self._address,
                include_dashboard=False if local else None,
                log_to_driver=False,
                logging_level=logging.ERROR,
                **local,
            )
        except (OSError, ValueError, RuntimeError) as error:
            text = " ".join(str(error).split())[:200]
            raise EvaluationError(f"no Ray cluster at {self._address!r}: {text}") from error
        try:
            yield
        finally:
            self._ray.shutdown()

    def _check_nodes(self, num_cpus: float) -> None:
        """Makes sure that tasks will not wait forever for what no node has."""
        needs = {"CPU": num_cpus, "GPU": self._num_gpus}
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        if not any(all(node.get(key, 0.0) >= needs[key] for key in needs) for node in nodes):
            listed = ", ".join(f"{value:g} {key}" for key, value in needs.items())
            raise EvaluationError(f"no node of the Ray cluster has what a task needs: {listed}")


class _RayWorkers:
    """Workers on the cluster, each known by the reference to what it will return."""

    def __init__(self, ray: Any, work: Any, mailbox: Any) -> None:  # noqa: ANN401
        self._ray = ray
        self._work = work
        self._mailbox = mailbox
        self._started: list[Any] = []

    def start(self, task: EvaluationTask, options: EvaluationOptions) -> Any:  # noqa: ANN401
        number = len(self._started)
        self._started.append(self._work.remote(self._mailbox, number, task, options))
        return self._started[number]

    def events(self, handles: list[Any]) -> Iterator[tuple[Any, TaskEvent | Ended]]:
        ended, _ = self._ray.wait(handles, timeout=_POLL_S)
        for number, event in self._ray.get(self._mailbox.empty.remote()):
            yield self._started[number], event
        for reference in ended:
            try:
                self._ray.get(reference)
            except self._ray.exceptions.RayError as error:
                yield reference, Ended(_first_line(error))
            else:
                yield reference, Ended()


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:200]}"


def _check_address(address: str) -> None:
    """Raises OSError if nobody listens there: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()


def _imported_ray() -> Any:  # noqa: ANN401 - Ray is optional, so its types are
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise
        raise EvaluationError(_NO_RAY) from error
    return ray
