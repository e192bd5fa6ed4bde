#!/usr/bin/env bash
# SUBJECT  hydra4 0.2.0 (Hesai packets to NumPy), with pypcd4 1.5.1, numpy 2.4.6
# GUESS    Stamps of the points of one PandarXT32 packet lie within 0.4 ms, and are those of the
#          packet, which a sensor that is synchronised by PTP or GPS gives in UTC.
# SEEN     They lie 350 s apart: the offsets of the blocks, 50 in microseconds, are added as
#          seconds, those of the channels as microseconds. The first block of a packet is 346.72 s
#          before the time in it, the last 3.28 s after. Besides, the date in the packet is taken
#          as local time: with a clock set to Japan all stamps are 9 hours early. The other
#          decoder, PandarOT128, has its offsets in seconds.
# WHY IT MATTERS
#          Points are right, so a viewer shows nothing. Deskewing with such stamps tears a sweep
#          apart, and matching them with an IMU finds nothing. Subtract the minimum and look at
#          the span of the stamps of a sweep before using them: 0.1 s is right at 10 Hz.
# SOURCE   Run below; decoders/pandar_xt32.py in the package, for packets (version 6.1) and
#          offsets. A sensor that turns 10 times a second needs 50 us for 0.18 degrees, a block.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 120 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  hydra4==0.2.0 pypcd4==1.5.1 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
import os
import struct
import time
from datetime import datetime, timezone
from importlib.metadata import version

import numpy as np
from hydra4 import Hydra
from hydra4.msgs import pandar_msgs__msg__PandarPacket as Packet
from hydra4.msgs import pandar_msgs__msg__PandarScan as Scan

print(*(f"{name} {version(name)}" for name in ("hydra4", "pypcd4", "numpy")))
sent = datetime(2026, 1, 2, 3, 4, 5, 250_000, tzinfo=timezone.utc)
BLOCKS, CHANNELS = 8, 32


def packet(first_azimuth):
    """All channels see something at 10 m; a block every 0.18 degrees, single return."""
    data = struct.pack("!BBBBH", 0xEE, 0xFF, 6, 1, 0)
    data += struct.pack("!BBBBBB", CHANNELS, BLOCKS, 0, 4, 1, 0)
    for block in range(BLOCKS):
        data += struct.pack("<H", (first_azimuth + 18 * block) % 36000)
        data += struct.pack("<HBB", 2500, 50, 0) * CHANNELS  # in units of 4 mm
    date = (sent.year - 1900, sent.month, sent.day, sent.hour, sent.minute, sent.second)
    data += bytes(10) + struct.pack("<BH6BIB", 0x37, 600, *date, sent.microsecond, 0x42)
    data += bytes(4)
    return Packet(stamp=None, data=np.frombuffer(data, np.uint8), size=len(data))


def stamps(zone):
    """Seconds between the points of one packet and the time in it, blocks x channels."""
    os.environ["TZ"] = zone
    time.tzset()
    scan = Scan(header=None, packets=[packet(35800), packet(0)])  # the second ends the sweep
    (cloud,) = Hydra(Hydra.Model.PandarXT32).to_pypcd4(scan)
    xyz = cloud.numpy(("x", "y", "z"))
    assert cloud.points == BLOCKS * CHANNELS
    assert np.allclose(np.linalg.norm(xyz, axis=1), 10.0, atol=1e-3), "points are not right"
    offsets = cloud.pc_data["stamp"] - sent.timestamp()
    return offsets.reshape(BLOCKS, CHANNELS)


offsets = stamps("UTC0")
print("seconds from the time in the packet to the first channel of each block:")
print(" ", np.round(offsets[:, 0], 3).tolist())
channels = np.ptp(offsets, axis=1).max()
print(f"  among the channels of a block {channels * 1e6:.0f} us")
assert np.allclose(np.diff(offsets[:, 0]), 50.0, atol=1e-5), "blocks are not 50 s apart now"
assert np.isclose(offsets[0, 0], -346.72, atol=1e-3)
assert np.isclose(offsets[-1, 0], 3.28, atol=1e-3)
assert 45e-6 < channels < 49e-6

hours = (stamps("JST-9") - offsets) / 3600
print(f"with the clock of the computer set to Japan: {hours.mean():+.1f} hours")
assert np.allclose(hours, -9.0), "the local time zone does not matter now"
print("as stated: blocks are 50 s apart, not 50 us")
EOF
