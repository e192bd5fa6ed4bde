# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Publishes the messages of a recording at its pace, as `ros2 bag play` does."""

import heapq
import itertools
import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import itemgetter
from typing import Any, Final, TypeVar

from mnsf_ros.node.cloud_topics import OWN_PLAYER
from mnsf_ros.node.raw_topics import MessageTypeError, RawTopics, begins_with_header
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CDR, CLOUD_TYPES
from msg_utils.stamps import NANOSECONDS_PER_SECOND as NANOSECONDS

# Subscribers need a while to find publishers; the node looks for them 5 times a second.
_SETTLE_S: Final = 0.5
_POLL_S: Final = 0.05
_CLOCK_PERIOD_S: Final = 0.025
# Between the stamps of two rounds, which follow each other at once. All that moves jumps back: for
# whoever follows it, it is a break.
_GAP_NS: Final = 10 * NANOSECONDS
_HEADER_AT: Final = 4

Publish = Callable[[bytes], None]
Timed = TypeVar("Timed", bound=tuple[Any, ...])


def play(
    reader: BagReader,
    on_message: Callable[[int], None],
    on_left_out: Callable[[str], None],
    *,
    topics: Sequence[str] = (),
    rate: float = 1.0,
    loop: bool = False,
    clock: bool = False,
    wait: bool = False,
) -> None:
    """Publishes the messages of a recording, each when it is due.

    Args:
        reader: The recording, open.
        on_message: Called with the number of messages published so far.
        on_left_out: Called once for each topic that cannot be published, with the reason.
        topics: Only these, which must be in the recording; all if empty.
        rate: Speed over that of the recording, above 0.
        loop: Start again at the end. Stamps go on if all messages begin with a header, else they
            go back.
        clock: Publish the time of the recording on /clock, for `use_sim_time`.
        wait: Start when somebody subscribes to a cloud of the recording.

    Raises:
        RecordingError: Damage is met.
        MessageTypeError: No topic can be published.
    """
    with RawTopics(OWN_PLAYER) as ros:
        publishers = _publishers(reader, ros, topics, on_left_out)
        tell_time = ros.clock() if clock else None
        clouds = [one for one in publishers if reader.topics[one].msgtype in CLOUD_TYPES]
        while wait and not any(map(ros.node.count_subscribers, clouds)):
            ros.spin_for(_POLL_S)
        ros.spin_for(_SETTLE_S)
        goes_on = all(begins_with_header(reader.topics[one].msgtype) for one in publishers)
        first_ns, last_ns = reader.span_ns
        round_ns = last_ns - first_ns + _GAP_NS if goes_on else 0
        number = 0
        for index in itertools.count() if loop else range(1):
            messages = _later(_in_order(reader, list(publishers)), index * round_ns)
            for _, topic, raw in in_time(messages, ros.spin_for, rate, tell_time):
                publishers[topic](raw)
                number += 1
                on_message(number)
        ros.spin_for(_SETTLE_S)  # what was published last is still under way


def _publishers(
    reader: BagReader, ros: RawTopics, chosen: Sequence[str], on_left_out: Callable[[str], None]
) -> dict[str, Publish]:
    publishers: dict[str, Publish] = {}
    for topic in dict.fromkeys(chosen) or reader.topics:
        summary = reader.topics[topic]
        if summary.encoding != CDR:
            on_left_out(f"{topic} is left out: its messages are {summary.encoding}, expected CDR")
            continue
        try:
            publisher = ros.publisher(topic, summary.msgtype, is_latched=summary.is_latched)
        except MessageTypeError as error:
            on_left_out(f"{topic} is left out: {error}")
        else:
            publishers[topic] = publisher.publish
    if not publishers:
        raise MessageTypeError(f"{reader.path}: no topic can be published")
    return publishers


def _in_order(reader: BagReader, topics: Sequence[str]) -> Iterator[tuple[int, str, bytes]]:
    """Time, topic and serialized message, of several topics in the order of time."""

    def of(topic: str) -> Iterator[tuple[int, str, bytes]]:
        return ((time_ns, topic, raw) for time_ns, raw in reader.raw_messages(topic))

    return heapq.merge(*map(of, topics), key=itemgetter(0))


def _later(
    messages: Iterable[tuple[int, str, bytes]], shift_ns: int
) -> Iterator[tuple[int, str, bytes]]:
    """The messages, which begin with a header, and their stamps so much later."""
    for time_ns, topic, raw in messages:
        yield time_ns + shift_ns, topic, _stamped_later(raw, shift_ns) if shift_ns else raw


def _stamped_later(raw: bytes, shift_ns: int) -> bytes:
    # CDR: the second of four bytes tells the order of bytes; seconds and nanoseconds follow.
    form = "<iI" if raw[1] & 1 else ">iI"
    seconds, nanoseconds = struct.unpack_from(form, raw, _HEADER_AT)
    later = divmod(seconds * NANOSECONDS + nanoseconds + shift_ns, NANOSECONDS)
    result = bytearray(raw)
    # The year 2038 goes on as 1970.
    struct.pack_into(form, result, _HEADER_AT, later[0] % 2**31, later[1])
    return bytes(result)


def in_time(
    messages: Iterable[Timed],
    wait_s: Callable[[float], None],
    rate: float = 1.0,
    tell_time: Callable[[int], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Timed]:
    """Yields messages, which begin with their time in nanoseconds, each when it is due.

    Args:
        messages: In the order of time; the first one is due at once.
        wait_s: Waits for some seconds.
        rate: Speed over that of the recording, above 0.
        tell_time: Called with the time of the recording every 25 ms, if given.
        clock: Gives seconds.
    """
    start: tuple[int, float] | None = None
    for message in messages:
        time_ns = message[0]
        start_ns, start_s = start = start or (time_ns, clock())
        due_s = start_s + (time_ns - start_ns) / NANOSECONDS / rate
        while tell_time is not None and (left_s := due_s - clock()) > _CLOCK_PERIOD_S:
            tell_time(time_ns - round(left_s * rate * NANOSECONDS))
            wait_s(_CLOCK_PERIOD_S)
        wait_s(max(0.0, due_s - clock()))
        if tell_time is not None:
            tell_time(time_ns)
        yield message
