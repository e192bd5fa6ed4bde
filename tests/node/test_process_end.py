# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A process in which a library never returns ends all the same."""

import subprocess
import sys

import pytest

# PyDLL keeps the interpreter's lock: no thread of Python runs any more.
_HANGS = (
    "import ctypes; from mnsf_ros.node.process_end import exit_within; "
    "exit_within(1, {}); ctypes.PyDLL(None).pause()"
)


@pytest.mark.parametrize("status", [0, 2])
def test_it_ends_with_its_status(status):
    command = [sys.executable, "-c", _HANGS.format(status)]
    assert subprocess.run(command, timeout=300, check=False).returncode == status


def test_one_that_is_called_off_lives_on():
    lines = (
        "import time; from mnsf_ros.node.process_end import exit_within; "
        "call_off = exit_within(1, 3); call_off(); time.sleep(2)"
    )
    assert subprocess.run([sys.executable, "-c", lines], timeout=300, check=True).returncode == 0


# The regular expression computes for ever, and holds the interpreter's lock.
def test_leaving_the_graph_that_never_ends_ends_the_process(ros):
    lines = (
        "import re; from mnsf_ros.node import process_end, raw_topics; "
        "process_end.END_TIMEOUT_S = 1; topics = raw_topics.RawTopics('leaves'); "
        "topics.node.destroy_node = lambda: re.match('(a+)+$', 'a' * 99 + 'b'); topics.__exit__()"
    )
    status = subprocess.run([sys.executable, "-c", lines], timeout=300, check=False).returncode
    assert status == 1


def test_time_in_which_it_does_not_compute_may_not_count():
    lines = (
        "import time; from mnsf_ros.node.process_end import exit_within; "
        "exit_within(1, 3, time.CLOCK_PROCESS_CPUTIME_ID); time.sleep(2)"
    )
    assert subprocess.run([sys.executable, "-c", lines], timeout=300, check=True).returncode == 0


def test_one_that_ends_earlier_is_not_held_up():
    lines = "from mnsf_ros.node.process_end import exit_within; exit_within(1000, 3)"
    assert subprocess.run([sys.executable, "-c", lines], timeout=300, check=True).returncode == 0
