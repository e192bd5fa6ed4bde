# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small recordings of each format, damaged at random and evaluated, for `reliability.py`.

Verdicts:

* refused: one line says that nothing can be read;
* same: every row is that of the undamaged recording;
* partial: the errors that are there are right, and damage or a warning was reported;
* warned: errors differ, and damage or a warning was reported;
* unprotected: rows differ without a warning, but the recording has no checksums: nobody can notice
  flipped bits within a message;
* silent: rows differ, the recording has checksums, and nothing was reported. Must not happen;
* crash, hang: must not happen either.
"""

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
from rosbags.convert import convert
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, evaluated_methods
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_folder import to_json
from mnsf_ros.evaluation.task import FinishedTask, run_task
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

LIMIT_S = 60
MAX_GB = 2.0
METHODS = ("zero", "ego")
BAD = ("silent", "crash", "hang")
DAMAGES = ("flip", "flip at end", "cut", "length", "zero", "double")
WRONG_LENGTHS = (2**63 - 1, 2**64 - 1, 2**40, 2**32 - 1, 2**31, 7, 0)
JAZZY: Final = get_typestore(Stores.ROS2_JAZZY)
# Receive time, topic, type and CDR bytes.
Message = tuple[int, str, str, bytes]
Rows = dict[tuple[str, int], dict[str, Any]]
Counts = dict[str, Counter[str]]


class HangError(BaseException):
    """An evaluation took too long; no Exception, so that nobody catches it on the way."""


def write_originals(folder: Path) -> dict[str, Path]:
    """Writes a small recording in each format; returns the format and the file to damage."""
    settings = SimulationSettings(duration_s=0.6, num_beams=16, num_columns=48)
    folder.mkdir(parents=True)
    write_recording(settings, folder / "plain")
    shutil.copytree(folder / "plain", folder / "described")
    files = {
        "mcap": folder / "plain" / "plain.mcap",
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
    files["ros1"] = folder / "ros1.bag"
    _convert(folder / "plain", folder / "sqlite", Stores.ROS2_JAZZY)
    _convert(folder / "plain", files["ros1"], Stores.ROS1_NOETIC)
    return files


def _convert(source: Path, out: Path, store: Stores) -> None:
    """Writes a recording of ROS 1, or a folder of SQLite."""
    everything: list[list[str]] = [[]] * 4
    convert([source], out, "sqlite3", 9, None, "none", None, get_typestore(store), *everything)


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


def mutated(data: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    """Returns damaged data, and the name of the damage."""
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
        # Huge, negative, or a little off.
        wrong = WRONG_LENGTHS[int(random.integers(len(WRONG_LENGTHS)))]
        data[start : start + 8] = wrong.to_bytes(8, "little")[: length - start]
    elif kind == "zero":
        data[start : start + size] = bytes(len(data[start : start + size]))
    else:
        data[start:start] = data[start : start + size]
    return bytes(data), kind


def evaluate(path: Path) -> tuple[Rows, bool, bool]:
    """Rows without times by method and stamp, and whether there are warnings and checksums."""
    recording = choose_topics(path, "bag", points="/points")
    # The results also warn of missing truth and odometry.
    is_warned = bool(recording.damages) or None in (recording.truth, recording.odometry)
    options = EvaluationOptions(preset("paper"), num_points=100)
    rows = {}
    for method in evaluated_methods(METHODS, options):
        for event in run_task(EvaluationTask(recording, method), options):
            if isinstance(event, FinishedTask):
                is_warned = is_warned or bool(event.damages) or bool(event.counts)
                continue
            row = json.loads(to_json(event))
            is_warned = is_warned or bool(row["failure"])
            del row["time_ms"], row["stage_times_ms"]
            rows[method.name, row["stamp_ns"]] = row
    with BagReader(path) as reader:
        return rows, is_warned, reader.has_checksums


def judge(path: Path, expected: Rows) -> tuple[str, str]:
    """Returns the verdict on a damaged recording, and its reason."""
    signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LIMIT_S)
    try:
        rows, is_warned, has_checksums = evaluate(path)
    except (MnsfError, MemoryError) as error:
        return "crash" if "\n" in str(error) else "refused", str(error)
    except HangError:
        return "hang", f"more than {LIMIT_S} s"
    except Exception:  # noqa: BLE001 - a traceback is what is looked for
        return "crash", traceback.format_exc()
    finally:
        signal.alarm(0)
    # An example may lose its truth, or its number if a sweep before it is lost; the errors that are
    # there must be the same.
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


def run(
    rounds: Iterable[tuple[int, np.random.Generator]], folder: Path
) -> tuple[Counts, list[str]]:
    """Damages and judges recordings; returns verdicts by format, and the bad recordings."""
    files = write_originals(folder / "originals")
    expected = {}
    for name, file in files.items():
        expected[name], is_warned, _ = evaluate(_recording(file))
        if is_warned or not expected[name]:
            raise RuntimeError(f"{file}: the original is not read without a warning")
    found: Counts = {name: Counter() for name in files}
    bad = []
    for number, random in rounds:
        name, file = list(files.items())[number % len(files)]
        whole = file.read_bytes()
        damaged, kind = mutated(whole, random)
        file.write_bytes(damaged)
        verdict, text = judge(_recording(file), expected[name])
        if verdict in BAD:
            kept = folder / f"bad_{number}_{file.name}"
            kept.write_bytes(damaged)
            bad.append(f"{verdict}: {name}, {kind}, number {number}: {text}: {kept}")
        file.write_bytes(whole)
        found[name][verdict] += 1
    return found, bad


def _recording(file: Path) -> Path:
    # A recording of rosbag2 is a folder.
    return file.parent if (file.parent / "metadata.yaml").exists() else file
