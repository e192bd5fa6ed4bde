# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tasks on a Ray cluster of two nodes, one of which is killed half-way."""

from __future__ import annotations

import os

import pytest
import small_evaluations as small

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation import ray_cluster
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import TaskFailed, TaskRestarted

# Ray's own code warns of this and that.
pytestmark = pytest.mark.filterwarnings("ignore")
METHODS = ("fnsf", "fnsf-joint", "mnsf")
# Long enough for a node to be killed in the middle of a task.
SLOW = {"optimization.max_iterations": 400, "field.hidden_width": 32}


@pytest.fixture(scope="module")
def ray():
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    return pytest.importorskip("ray")


@pytest.fixture
def cluster(ray):
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 80 * 2**20}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    ray.init(address=cluster.address, log_to_driver=False)
    yield cluster
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 6)


def rows_by_task(events):
    rows = {}
    for task, event in events:
        if isinstance(event, ResultRow):
            rows.setdefault(task.key, {})[event.number] = small.without_times(event)
    return rows


def test_lost_node_costs_time_but_nothing_else(ray, cluster, bag):
    from mnsf_ros.evaluation.ray_cluster import RayCluster

    node = cluster.add_node(num_cpus=1, object_store_memory=80 * 2**20)
    options = small.options(SLOW)
    runs = [small.task_at(bag, method) for method in METHODS]
    events, started = [], set()
    for task, event in RayCluster("auto")(runs, options):
        events.append((task, event))
        started.add(task.key)
        # There is room for one task on each node: when two have begun, both are at work.
        if node is not None and len(started) == 2:
            cluster.remove_node(node, allow_graceful=False)
            node = None
    assert node is None
    kinds = [type(event) for _, event in events]
    assert kinds.count(Findings) == 3
    assert TaskFailed not in kinds
    restarted = [event for _, event in events if isinstance(event, TaskRestarted)]
    assert 1 <= len(restarted) <= 2
    assert rows_by_task(events) == rows_by_task(run_serially(runs, options))


def test_lost_cluster_ends_all_tasks_with_a_reason(ray, cluster, bag, monkeypatch):
    """The mailbox is on the driver's own node: it is gone when that node is."""

    mailboxes = []
    start_mailbox = ray_cluster.start_mailbox

    def kept(module):
        mailboxes.append(start_mailbox(module))
        return mailboxes[-1]

    monkeypatch.setattr(ray_cluster, "start_mailbox", kept)
    runs = [small.task_at(bag, method) for method in METHODS]
    failed, finished, num_rows = {}, set(), 0
    for task, event in ray_cluster.RayCluster("auto")(runs, small.options(SLOW)):
        num_rows += isinstance(event, ResultRow)
        if num_rows == 1 and isinstance(event, ResultRow):
            ray.kill(mailboxes[0])
        if isinstance(event, Findings):
            finished.add(task.method.name)
        if isinstance(event, TaskFailed):
            failed[task.method.name] = event.reason
    assert num_rows >= 1
    # There is room for one task at a time: all the first one has posted may have come at once.
    assert finished <= {METHODS[0]}
    assert failed.keys() == {*METHODS} - finished
    assert all("the Ray cluster is lost: Actor" in text for text in failed.values())


def test_task_that_cannot_be_done_and_one_that_asks_for_too_much(ray, cluster, bag):
    from mnsf_ros.evaluation.ray_cluster import RayCluster

    runs = [small.task_at(bag, method) for method in ("nothing", "zero")]
    events = list(RayCluster("auto")(runs, small.options()))
    (failed,) = [(task.method.name, e) for task, e in events if isinstance(e, TaskFailed)]
    assert failed[0] == "nothing"
    assert "unknown method" in failed[1].reason
    assert len(rows_by_task(events)["drive", "zero"]) == 4
    with pytest.raises(EvaluationError, match="what a task needs: 1 CPU, 1000 GPU"):
        list(RayCluster("auto", num_gpus=1000)(runs, small.options()))


def test_no_cluster_at_the_address(ray, bag):
    from mnsf_ros.evaluation.ray_cluster import RayCluster

    runs = [small.task_at(bag, "zero")]
    with pytest.raises(EvaluationError, match="no Ray cluster at '127"):
        list(RayCluster("127.0.0.1:1")(runs, small.options()))


def test_negative_share_of_a_gpu(ray):
    from mnsf_ros.evaluation.ray_cluster import RayCluster

    with pytest.raises(EvaluationError, match="num_gpus: got -1"):
        RayCluster("local", num_gpus=-1)


def test_missing_ray_is_said_with_the_command_that_installs_it(monkeypatch):
    import sys

    from mnsf_ros.evaluation.ray_cluster import RayCluster

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(EvaluationError, match="pip install"):
        RayCluster("local")
