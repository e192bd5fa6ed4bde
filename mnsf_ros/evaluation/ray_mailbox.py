"""How tasks on a Ray cluster tell what they find as they find it."""

from __future__ import annotations

from typing import Any

from mnsf_ros.evaluation.evaluation_options import EvaluationOptions
from mnsf_ros.evaluation.task_runs import TaskEvent, TaskRun, task_events

# Number of a task and of its attempt.
Place = tuple[int, int]


class Mailbox:
    """Where tasks post their events; it lives beside the driver and is lost only with it."""

    def __init__(self) -> None:
        self._posts: list[tuple[Place, TaskEvent]] = []

    def post(self, place: Place, event: TaskEvent) -> None:
        """Takes an event of a task's attempt."""
        self._posts.append((place, event))

    def empty(self) -> list[tuple[Place, TaskEvent]]:
        """Gives out all events since the last time."""
        posts, self._posts = self._posts, []
        return posts


def post_events(
    mailbox: Any,  # noqa: ANN401 - a handle of an actor
    place: Place,
    run: TaskRun,
    options: EvaluationOptions,
) -> None:
    """Runs a task and posts its events. Runs on the cluster."""
    import ray

    for event in task_events(run, options):
        # Waits until it is there, so that nothing is on its way when the task ends.
        ray.get(mailbox.post.remote(place, event))


def start_mailbox(ray: Any) -> Any:  # noqa: ANN401 - Ray is optional, so its types are
    """Starts a mailbox on the node of the driver; returns the handle of the actor."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    # Nowhere else, not even for a moment: another node may be lost.
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    return ray.remote(num_cpus=0, scheduling_strategy=here)(Mailbox).remote()
