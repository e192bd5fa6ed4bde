#!/usr/bin/env bash
# SUBJECT  mcap-ros2-support 0.6.0 (writes ROS 2 messages to MCAP), beside
#          mcap-ros2-support-fast 0.8.0
# GUESS    A list that is too short or too long for float64[36], or for float32[<=3], is refused.
# SEEN     A short list of numbers is filled up with zeros, a long one is cut, and so is a bounded
#          sequence, without a word; the caller's own short list grows by None up to the length of
#          the field. mcap-ros2-support-fast refuses all three.
# WHY IT MATTERS
#          The six variances of a pose, written as covariance, arrive as its first row: five
#          correlations of x, and a variance of zero (known exactly) for y, z and the angles. A
#          filter that reads the recording trusts it without limit.
# SOURCE   Run below; mcap_ros2.writer.Writer, mcap_ros2.decoder.DecoderFactory.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 50 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  mcap==1.6.0 mcap-ros2-support==0.6.0 mcap-ros2-support-fast==0.8.0
"$dir/venv/bin/python" - <<'EOF'
import io
from importlib.metadata import version
from types import SimpleNamespace

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from mcap_ros2_support_fast import ROS2EncoderFactory

for name in ("mcap-ros2-support", "mcap-ros2-support-fast"):
    print(name, version(name))

NAME, DEFINITION = "demo_msgs/msg/Estimate", "float64[36] covariance\nfloat32[<=3] size\n"
given = {
    "six variances": {"covariance": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], "size": []},
    "40 values": {"covariance": list(range(40)), "size": []},
    "five of three": {"covariance": [0.0] * 36, "size": [1.0, 2.0, 3.0, 4.0, 5.0]},
}
fast = ROS2EncoderFactory().encoder_for(
    SimpleNamespace(id=1, name=NAME, encoding="ros2msg", data=DEFINITION.encode())
)
for case, message in given.items():
    numbers = list(message["covariance"])
    file = io.BytesIO()
    writer = Writer(file)
    schema = writer.register_msgdef(NAME, DEFINITION)
    writer.write_message("/estimate", schema, message)
    writer.finish()
    reader = make_reader(io.BytesIO(file.getvalue()), decoder_factories=[DecoderFactory()])
    ((_, _, _, read),) = reader.iter_decoded_messages()
    covariance, size = list(read.covariance), list(read.size)
    print(f"{case}: covariance {covariance[:8]} ..., size {size}")
    assert covariance == (numbers + [0.0] * 36)[:36], "short or long arrays are treated otherwise"
    if len(numbers) < 36:
        print(f"  the caller's list afterwards: {message['covariance'][:8]} ...")
        assert message["covariance"] == numbers + [None] * 30, "the caller's list is left alone now"
        message["covariance"] = numbers
    assert size == message["size"][:3], "bounded sequences are treated otherwise"
    try:
        fast(message)
    except Exception as error:
        print(f"  mcap-ros2-support-fast: {type(error).__name__}: {error}")
    else:
        raise SystemExit("mcap-ros2-support-fast accepts it now")
print("as stated: filled up or cut without a word")
EOF
