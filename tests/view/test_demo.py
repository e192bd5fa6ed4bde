# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`make demo`: the live node, a street that is played to it, and its page, until Ctrl-C."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import urlopen

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.recording.bag_reader import open_recording
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.other_clouds import CLOUD_TYPE

CHECKOUT = Path(__file__).parents[2]


@pytest.mark.slow
def test_flow_comes_out_and_ctrl_c_ends_all_of_it(
    make_street, tmp_path: Path, own_domain: None
) -> None:
    recording, flows = tmp_path / "own", []
    with (
        open_recording(make_street(duration_s=2.0, num_columns=360), pytest.fail) as street,
        BagWriter(recording) as writer,
    ):
        for time_ns, raw in street.raw_messages("/points"):
            writer.write_raw("/robot/lidar", CLOUD_TYPE, time_ns, bytes(raw))
    places = [f"BIN={Path(sys.executable).parent}", "READY=", f"BAG={recording}"]
    command = ["make", "demo", *places, f"DOMAIN={os.environ['ROS_DOMAIN_ID']}"]
    with (
        RawTopics("listener") as ros,
        subprocess.Popen(
            command, cwd=CHECKOUT, stderr=subprocess.PIPE, text=True, start_new_session=True
        ) as demo,
    ):
        try:
            told = (re.search(r"open (\S+) in a browser", line) for line in demo.stderr)
            with urlopen(next(filter(None, told))[1]) as page:
                assert b"<canvas" in page.read()
            ros.subscribe("/scene_flow/flow", CLOUD_TYPE, flows.append)
            give_up_s = time.monotonic() + 120
            while not flows and time.monotonic() < give_up_s:
                ros.spin_for(0.1)
            os.killpg(demo.pid, signal.SIGINT)
            demo.communicate(timeout=30)
            assert flows
            with pytest.raises(ProcessLookupError):
                os.killpg(demo.pid, 0)
        finally:
            if demo.poll() is None:
                os.killpg(demo.pid, signal.SIGKILL)
