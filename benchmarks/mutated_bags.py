# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Evaluates damaged recordings by the thousand, for `reliability.py recordings`.

Small recordings of each format are damaged at random: flipped bytes, cuts, wrong lengths, blocks
that are zeroed, doubled or moved. Each is inspected and evaluated with methods whose results are
known. What comes out is one of:

* refused: one line says that nothing can be read;
* same: every row is that of the undamaged recording, whatever was reported;
* partial: the errors that are there are right, and damage or a warning was reported;
* warned: errors differ, and damage or a warning was reported;
* unprotected: rows differ without a warning, but the recording has no checksums, which every
  result says in its notes: bits that flip within a message cannot be noticed by anybody;
* silent: rows differ, the recording has checksums, and nothing was reported. Must not happen;
* crash, hang: must not happen either, nor may the process take more than 2 GB.
"""

from __future__ import annotations

import json
import shutil
import signal
import traceback
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, evaluated_methods
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

LIMIT_S = 60
MAX_PEAK_MB = 2000
METHODS = ("zero", "ego")
BAD = ("silent", "crash", "hang")
DAMAGES = ("flip", "flip at end", "cut", "length", "zero", "double", "move")
WRONG_LENGTHS = (2**63 - 1, 2**64 - 1, 2**40, 2**32 - 1, 2**31, 7, 0)
JAZZY: Final = get_typestore(Stores.ROS2_JAZZY)
NOETIC: Final = get_typestore(Stores.ROS1_NOETIC)
# Receive time, topic, type and CDR bytes.
Message = tuple[int, str, str, bytes]
Rows = dict[tuple[str, int], dict[str, Any]]
Counts = dict[str, Counter[str]]


class HangError(BaseException):
    """An evaluation took too long. Not an Exception, so that nobody catches it on the way."""


def write_originals(folder: Path) -> dict[str, Path]:
    """Writes a small recording in each format; returns the format and the file to damage."""
    settings = SimulationSettings(duration_s=0.6, num_beams=16, num_columns=48)
    folder.mkdir(parents=True)
    write_recording(settings, folder / "plain")
    write_recording(settings, folder / "compressed", compress=True)
    shutil.copytree(folder / "plain", folder / "described")
    files = {
        "mcap": folder / "plain" / "plain.mcap",
        "mcap zstd": folder / "compressed" / "compressed.mcap",
        "metadata.yaml": folder / "described" / "metadata.yaml",
    }
    mcap_options: dict[str, dict[str, Any]] = {
        "mcap zstd checked": {"compression": CompressionType.ZSTD, "chunk_size": 8192},
        "mcap lz4 checked": {"compression": CompressionType.LZ4, "chunk_size": 8192},
        "mcap checked": {"compression": CompressionType.NONE, "chunk_size": 8192},
        "mcap bare": {"use_chunking": False, "index_types": IndexType.NONE},
    }
    with BagReader(folder / "plain") as reader:
        messages: list[Message] = sorted(
            (received_ns, topic, reader.topics[topic].msgtype, bytes(raw))
            for topic in reader.topics
            for received_ns, raw in reader.raw_messages(topic)
        )
    for name, options in mcap_options.items():
        files[name] = folder / f"{name.replace(' ', '_')}.mcap"
        _write_mcap(files[name], messages, options)
    files["sqlite3"] = folder / "sqlite" / "sqlite.db3"
    with Ros2Writer(folder / "sqlite", version=9, storage_plugin=StoragePlugin.SQLITE3) as ros2:
        _write_rosbags(ros2, JAZZY, messages)
    files["ros1"] = folder / "ros1.bag"
    with Ros1Writer(files["ros1"]) as ros1:
        converted = ((*each[:3], JAZZY.cdr_to_ros1(each[3], each[2])) for each in messages)
        _write_rosbags(ros1, NOETIC, converted)
    return files


def _write_mcap(file: Path, messages: Iterable[Message], options: dict[str, Any]) -> None:
    with file.open("wb") as stream:
        writer = McapWriter(stream, **options)
        writer.start("ros2", "mutated_bags")
        channels = {}
        for received_ns, topic, msgtype, raw in messages:
            if topic not in channels:
                definition, _ = JAZZY.generate_msgdef(msgtype, ros_version=2)
                schema = writer.register_schema(msgtype, "ros2msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], received_ns, raw, received_ns)
        writer.finish()


def _write_rosbags(
    writer: Ros1Writer | Ros2Writer,
    typestore: Typestore,
    messages: Iterable[Message],
) -> None:
    connections: dict[str, Any] = {}
    for received_ns, topic, msgtype, raw in messages:
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, msgtype, typestore=typestore)
        writer.write(connections[topic], received_ns, raw)


def mutated(data: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    """Damaged data, and the name of the damage."""
    data = bytearray(data)
    kind = str(random.choice(DAMAGES))
    length = len(data)
    if kind.startswith("flip"):
        low = max(0, length - 1500) if kind == "flip at end" else 0
        for _ in range(int(random.integers(1, 9))):
            data[int(random.integers(low, length))] ^= int(random.integers(1, 256))
        return bytes(data), kind
    start = int(random.integers(0, length))
    size = int(random.integers(1, 4000))
    if kind == "cut":
        del data[start:]
    elif kind == "length":
        # What a damaged length looks like: huge, negative, or just a little off.
        wrong = WRONG_LENGTHS[int(random.integers(len(WRONG_LENGTHS)))]
        data[start : start + 8] = wrong.to_bytes(8, "little")[: length - start]
    elif kind == "zero":
        data[start : start + size] = bytes(len(data[start : start + size]))
    elif kind == "double":
        data[start:start] = data[start : start + size]
    else:
        block = data[start : start + size]
        del data[start : start + size]
        target = int(random.integers(0, len(data) + 1))
        data[target:target] = block
    return bytes(data), kind


def evaluate(path: Path) -> tuple[Rows, bool, bool]:
    """Rows without times, by method and stamp; whether something was reported; checksums."""
    inspection = inspect_recording(path)
    recording = choose_topics(inspection, "bag", points="/points")
    # What the results would say: that truth or odometry is missing is a warning, too.
    is_warned = bool(inspection.damages) or None in (recording.truth, recording.odometry)
    options = EvaluationOptions(preset("paper"), num_points=100)
    rows = {}
    for method in evaluated_methods(METHODS, options):
        for event in run_task(EvaluationTask(recording, method), options):
            if isinstance(event, Findings):
                is_warned = is_warned or bool(event.damages) or bool(event.warnings)
                continue
            row = json.loads(to_json(event))
            is_warned = is_warned or bool(row["failure"])
            del row["time_ms"], row["stage_times_ms"]
            rows[method.name, row["stamp_ns"]] = row
    return rows, is_warned, inspection.has_checksums


def judge(path: Path, expected: Rows) -> tuple[str, str]:
    """What became of a damaged recording, and a text where that is bad."""
    signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LIMIT_S)
    try:
        rows, is_warned, has_checksums = evaluate(path)
    except MnsfError as error:
        return "crash" if "\n" in str(error) else "refused", str(error)
    except HangError:
        return "hang", f"more than {LIMIT_S} s"
    except Exception:  # noqa: BLE001 - that there is none is what is measured
        return "crash", traceback.format_exc()
    finally:
        signal.alarm(0)
    return _verdict(rows, expected, is_warned=is_warned, has_checksums=has_checksums)


def _verdict(
    rows: Rows, expected: Rows, *, is_warned: bool, has_checksums: bool
) -> tuple[str, str]:
    # An example may lose its truth, or its number if a sweep before it is lost; its errors, if it
    # has any, must be what they were.
    errors = {key: row["errors"] for key, row in expected.items()}
    wrong = [key for key, row in rows.items() if row["errors"] not in ({}, errors.get(key))]
    text = f"{len(rows)} rows, {len(wrong)} of them wrong, expected {len(expected)}"
    if rows == expected:
        return "same", text
    if is_warned:
        return "warned" if wrong else "partial", text
    return "silent" if has_checksums else "unprotected", text


def _hang(_number: int, _frame: FrameType | None) -> None:
    raise HangError


def run(numbers: Iterable[int], seed: int, folder: Path) -> tuple[Counts, Counts, list[str]]:
    """Damages and judges; returns format -> counts, kind of damage -> counts, and what is bad."""
    files = write_originals(folder / "originals")
    expected = {}
    for name, file in files.items():
        expected[name], is_warned, _ = evaluate(_recording(file))
        if is_warned or not expected[name]:
            raise RuntimeError(f"{file}: is damaged before anybody damaged it")
    by_format: Counts = {name: Counter() for name in files}
    by_kind: Counts = {}
    bad = []
    names = list(files)
    for index in numbers:
        name = names[index % len(names)]
        file = files[name]
        whole = file.read_bytes()
        data, kind = mutated(whole, np.random.default_rng([seed, index]))
        file.write_bytes(data)
        verdict, text = judge(_recording(file), expected[name])
        if verdict in BAD:
            kept = folder / f"bad_{index}_{file.name}"
            kept.write_bytes(data)
            bad.append(f"{verdict}: {name}, {kind}, number {index}: {text}: {kept}")
        file.write_bytes(whole)
        by_format[name][verdict] += 1
        by_kind.setdefault(kind, Counter())[verdict] += 1
    return by_format, by_kind, bad


def _recording(file: Path) -> Path:
    # Those of rosbag2 are folders.
    return file.parent if (file.parent / "metadata.yaml").exists() else file
