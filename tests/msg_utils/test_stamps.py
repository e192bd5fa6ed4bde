# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Header stamps: both directions, and values that a careless or hostile sender may set."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp, encode_stamp

LATEST = (2_147_483_647, 999_999_999, 2_147_483_647_999_999_999)


@pytest.mark.parametrize(
    ("sec", "nanosec", "stamp_ns"),
    [(0, 0, 0), (1, 0, 10**9), (1_700_000_000, 123_456_789, 1_700_000_000_123_456_789), LATEST],
)
def test_both_directions(sec, nanosec, stamp_ns):
    assert decode_stamp(SimpleNamespace(sec=sec, nanosec=nanosec)) == stamp_ns
    assert encode_stamp(stamp_ns) == (sec, nanosec)


def test_nanoseconds_of_a_second_or_more_are_carried():
    assert decode_stamp(SimpleNamespace(sec=7, nanosec=4_294_967_295)) == 11_294_967_295


@pytest.mark.parametrize(("name", "maximum"), [("sec", 2**31 - 1), ("nanosec", 2**32 - 1)])
@pytest.mark.parametrize("value", [-1, 2**32, 1.5, None, "now", np.array([1, 2])])
def test_impossible_stamps_are_refused(name, maximum, value):
    stamp = SimpleNamespace(**({"sec": 0, "nanosec": 0} | {name: value}))
    text = f"stamp.{name} is {value!r}, expected an integer from 0 to {maximum}"
    with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
        decode_stamp(stamp)


@pytest.mark.parametrize("stamp_ns", [-1, 2_147_483_648_000_000_000, 1e9])
def test_times_that_a_message_cannot_hold_are_refused(stamp_ns):
    text = f"stamp_ns is {stamp_ns}, expected an integer from 0 to 2147483647999999999"
    with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
        encode_stamp(stamp_ns)
