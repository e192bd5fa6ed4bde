# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""CPU of the page of `mnsf view` for each sweep, beside the estimate: with a viewer and without.

python benchmarks/page.py RECORDING
"""

from __future__ import annotations

import subprocess
import sys
import time
from itertools import islice
from pathlib import Path

from frame import make_parser

from mnsf_ros.online.stream import Stream
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.view.estimated_sweeps import EstimatedSweep, estimated_sweeps
from mnsf_ros.view.layers import scene_of
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.scene_message import Paths, scene_message

NUM_UPDATES = 50
INTERVAL_S = 0.1
VIEWER = """
import sys
from websockets.sync.client import connect
with connect(sys.argv[1], max_size=None) as viewer:
    for _ in viewer:
        pass
"""


def first_sweeps(path: Path) -> list[EstimatedSweep]:
    """Some sweeps of a recording with their flow."""
    with BagReader(path) as reader:
        topics = used_topics(path, reader.topics)
        return list(islice(estimated_sweeps(reader, topics, Stream(preset("online")), print), 10))


def shown_ms(server: PageServer, sweeps: list[EstimatedSweep]) -> float:
    """CPU milliseconds of this process for each sweep that is shown."""
    paths = Paths()
    start_s = time.process_time()
    for number in range(NUM_UPDATES):
        scene = scene_of(sweeps[number % len(sweeps)], "estimate")
        trails = paths.after(number + 1, scene.world_from_sensor, scene.objects)
        server.publish("scene", scene_message(scene, trails))
        time.sleep(INTERVAL_S)
    return 1e3 * (time.process_time() - start_s) / NUM_UPDATES


def resting_ms() -> float:
    """CPU milliseconds of this process in the time of one sweep, while it does nothing."""
    start_s = time.process_time()
    time.sleep(NUM_UPDATES * INTERVAL_S)
    return 1e3 * (time.process_time() - start_s) / NUM_UPDATES


def main() -> None:
    """Prints both."""
    parser = make_parser(__doc__, has_document=False)
    parser.add_argument("recording", type=Path)
    sweeps = first_sweeps(parser.parse_args().recording)
    server = PageServer()
    with server.listening("127.0.0.1", 0) as address:
        print(f"no viewer:  {resting_ms():.2f} ms a sweep")
        url = f"{address.replace('http', 'ws', 1)}socket"
        with subprocess.Popen([sys.executable, "-c", VIEWER, url]) as viewer:
            while server.num_viewers == 0:
                time.sleep(INTERVAL_S)
            print(f"one viewer: {shown_ms(server, sweeps):.2f} ms a sweep")
            viewer.kill()


if __name__ == "__main__":
    main()
