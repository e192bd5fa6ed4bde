# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whatever a cloud says of itself: points that fit, or a MessageError, and little memory."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mnsf_ros.settings import TimeSettings
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points

NAMES = st.sampled_from(["x", "y", "z", "t", "time", "intensity", "", "x\n", "\u2603"]) | st.text()
SIZES = st.sampled_from([0, 1, 2, 4, 12, 16, 32]) | st.integers(0, 2**32 - 1)
FIELDS = st.builds(
    SimpleNamespace,
    name=NAMES,
    offset=st.sampled_from([0, 4, 8, 12]) | SIZES,
    datatype=st.integers(1, 8) | st.integers(0, 255),
    count=st.just(1) | SIZES,
)
XYZ = [
    SimpleNamespace(name=name, offset=4 * axis, datatype=7, count=1)
    for axis, name in enumerate("xyz")
]
CLOUDS = st.builds(
    SimpleNamespace,
    header=st.builds(
        SimpleNamespace,
        frame_id=st.text(max_size=9),
        stamp=st.builds(
            SimpleNamespace, sec=st.integers(-(2**31), 2**31 - 1), nanosec=st.integers(0, 2**32 - 1)
        ),
    ),
    height=st.just(1) | SIZES,
    width=SIZES,
    fields=st.lists(FIELDS, max_size=5) | st.lists(FIELDS, max_size=3).map(XYZ.__add__),
    is_bigendian=st.booleans(),
    point_step=st.sampled_from([12, 16, 32]) | SIZES,
    row_step=SIZES,
    data=st.binary(max_size=600),
    is_dense=st.booleans(),
)
# More than the points themselves take, whatever a cloud claims.
MAX_BYTES = 4 * 2**20


@st.composite
def fitting(draw):
    """A cloud whose sizes fit its data."""
    cloud = draw(CLOUDS)
    cloud.height, cloud.point_step = 1, draw(st.sampled_from([12, 16, 20, 33]))
    cloud.width = len(cloud.data) // cloud.point_step
    cloud.row_step = cloud.width * cloud.point_step
    cloud.data = cloud.data[: cloud.row_step]
    return cloud


@given(CLOUDS | fitting())
def test_points_or_a_message_error(cloud):
    tracemalloc.start()
    try:
        points = decode_points(cloud)
    except MessageError as error:
        assert str(error)
    else:
        assert points.size == cloud.height * cloud.width
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < MAX_BYTES


@given(
    CLOUDS | fitting(),
    st.builds(
        TimeSettings,
        field=st.sampled_from(["auto", "none", "t", "intensity", "nothing"]),
        unit=st.sampled_from(["auto", "s", "ns"]),
        stamp=st.sampled_from(["auto", "start", "end"]),
    ),
)
def test_a_sweep_has_only_finite_points(cloud, settings):
    try:
        sweep = CloudReader().sweep(cloud, settings, 10**18)
    except MessageError as error:
        assert str(error)
        return
    assert np.isfinite(sweep.xyz).all()
    assert len(sweep.xyz) == np.count_nonzero(sweep.source.measured)
    assert sweep.times_s is None or len(sweep.times_s) == len(sweep)
