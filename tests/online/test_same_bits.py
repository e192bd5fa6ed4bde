# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The same sweeps give the same flow, bit for bit: in any run, with any number of threads."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from box_street import BoxStreet, pose, triplets_of

from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings

_TESTS = Path(__file__).resolve().parents[1]


def digest(num_threads=1):
    """Of all that a short drive gives."""
    street = BoxStreet()
    sweeps = [
        street.sweep(pose(0.6 * index, yaw_deg=index), index, cars=[(8 + 0.8 * index, -2)])
        for index in range(5)
    ]
    settings = Settings().changed({"compute.num_threads": num_threads, "compute.device": "cpu"})
    estimator, digests = ObjectFlowEstimator(settings), hashlib.sha256()
    for triplet in triplets_of(sweeps):
        result = estimator.estimate(triplet)
        known = result.over_ground
        assert known.dynamic.any()
        parts = (known.motion, known.dynamic, known.confidence, known.world_from_sensor)
        parts += (known.track_ids, *(each.velocity for each in known.objects))
        parts += tuple(each.center for each in known.objects)
        for array in (result.flow, result.kept, *parts):
            digests.update(np.ascontiguousarray(array).tobytes())
    return digests.hexdigest()


@pytest.fixture(scope="module")
def expected():
    return digest()


@pytest.mark.parametrize("num_threads", [2, 4])
def test_in_one_process(expected, num_threads):
    assert digest(num_threads) == expected


@pytest.mark.parametrize("num_threads", ["2", "7"])
def test_in_a_fresh_process(expected, num_threads):
    libraries = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = os.environ | dict.fromkeys(libraries, num_threads)
    environment["PYTHONPATH"] = os.pathsep.join(
        map(str, (_TESTS.parent, _TESTS, Path(__file__).parent))
    )
    environment["PYTHONHASHSEED"] = num_threads
    done = subprocess.run(
        [sys.executable, "-c", "import test_same_bits; print(test_same_bits.digest())"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == expected, done.stderr
