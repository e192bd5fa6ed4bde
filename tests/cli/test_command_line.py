# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the `mnsf` command says and which status it ends with."""

import logging

import pytest

from mnsf_ros.cli.console import show_warnings
from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_yaml


def only_line(capsys):
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("mnsf: ")
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evalute", "street"], "did you mean evaluate?"),
        (["street.mcap"], "no command 'street.mcap'; expected one of view, play,"),
        (["simulate", "street", "--beams", "16"], "--beams 16; see mnsf simulate --help"),
        (["estimate", "."], "required: --out"),
        (["evaluate", ".", "--num-points=-1"], "argument --num-points: got -1, expected a whole"),
        (["evaluate", ".", "--workers=0"], "argument --workers: got '0', expected a whole number"),
        (["view", "--port=70000"], "argument --port: got '70000', expected a whole number from 0"),
        (["view", "--node=bad name"], "argument --node: got 'bad name', expected a name of"),
        (["view", "--rate=2"], "--rate is for recordings, but the node is shown"),
        (["view", ".", "--node=/front"], "--node is for the node, but . is shown"),
        (["convert", "kitti", ".", "x", "--box-margin=nan"], "--box-margin: got 'nan', expected 0"),
        (
            ["explain", ".", "--stamp=1", "--at=1,2", "--picture=no/place.png"],
            "argument --picture: got 'no/place.png', expected a file in a folder that exists",
        ),
        (["play", ".", "--rate", "nan"], "expected 0.01 to 100"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, words, capsys):
    assert run(arguments) == EXIT_USAGE
    assert words in only_line(capsys)


def test_without_a_command_says_which_there_are(capsys):
    with pytest.raises(SystemExit, match=str(EXIT_USAGE)):
        run([])
    assert "simulate    write a recording" in capsys.readouterr().err


def test_parameters_prints_a_parameter_file(capsys):
    assert run(["parameters"]) == 0
    printed = capsys.readouterr().out
    assert printed.endswith(settings_yaml(Settings(), "x").partition("\n")[2])


HOSTILE = "\x1b]0;owned\x07\x9b31m\u202e<script>`"


def test_names_of_files_send_nothing_to_the_terminal(tmp_path, capsys):
    out = tmp_path / HOSTILE
    few = ["--duration-s=0.3", "--num-beams=16", "--num-columns=90"]
    assert run(["simulate", str(out), *few]) == 0
    evaluate = ["evaluate", str(out), "--methods=zero", "--pictures=0", "--out"]
    assert run([*evaluate, str(tmp_path / f"r{HOSTILE}")]) == 0
    assert run([*evaluate, str(out)]) == EXIT_USAGE
    assert run(["simulate", "x", "--colour", HOSTILE]) == EXIT_USAGE
    printed = capsys.readouterr()
    for text in (printed.out, printed.err):
        assert r"\x1b]0;owned\x07\x9b31m\u202e" in text
        assert not set(text) & set("\x1b\x07\x9b\u202e")
    for name in ("results.md", "results.csv", "results.tex"):
        text = (tmp_path / f"r{HOSTILE}" / name).read_text()
        assert not set(text) & set("\x1b\x07\x9b\u202e")


def test_warnings_send_nothing_to_the_terminal(capsys, monkeypatch):
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    show_warnings()
    logging.getLogger("mnsf_ros.view").warning("no flow: %s", "field \x1b[31m")
    assert capsys.readouterr().err == "no flow: field \\x1b[31m\n"


def test_simulate_writes_a_recording(tmp_path, capsys):
    out = tmp_path / "street"
    small = ["--duration-s", "0.3", "--num-beams", "16", "--num-columns", "90"]
    assert run(["simulate", str(out), *small]) == 0
    with BagReader(out) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            "/points": 3,
            "/truth/flow": 3,
            "/truth/odometry": 3,
        }
    said = capsys.readouterr().out.splitlines()[-1]
    assert said == f"{out}: 3 sweeps of the scenario street with true flow, seed 0"
    assert run(["simulate", str(out), *small]) == EXIT_USAGE
    ended = capsys.readouterr()
    assert ended.out == "", "no bar of what will not be done"
    assert ended.err == f"mnsf: {out}: exists already; --force replaces it\n"
    assert run(["simulate", str(out), *small, "--force"]) == 0


def test_a_wrong_value_is_one_line_and_leaves_nothing(tmp_path, capsys):
    assert run(["simulate", str(tmp_path / "street"), "--duration-s", "0"]) == EXIT_USAGE
    assert "--duration-s" in only_line(capsys)
    assert list(tmp_path.iterdir()) == []


def other_bag(path):
    with BagWriter(path) as writer:
        for stamp_ns in (1, 2):
            writer.write_raw("/talk", "std_msgs/msg/Empty", stamp_ns, b"\x00\x01\x00\x00\x00")
    return path


@pytest.mark.parametrize(
    ("prepare", "arguments", "said"),
    [
        (lambda path: path / "nowhere", [], "nowhere"),
        (lambda path: path, [], "no recording"),
        (other_bag_in := (lambda path: other_bag(path / "bag")), [], "/talk"),
        (other_bag_in, ["--points", "/points"], "/talk"),
        (other_bag_in, ["--points", "/talk"], "std_msgs/msg/Empty"),
    ],
    ids=["missing", "empty folder", "no clouds", "unknown topic", "other type"],
)
def test_a_command_names_what_is_wrong_with_a_bag(prepare, arguments, said, tmp_path, capsys):
    bag, out = prepare(tmp_path), tmp_path / "out"
    assert run(["evaluate", str(bag), "--out", str(out), *arguments]) == EXIT_USAGE
    assert said in only_line(capsys)
    assert not out.exists()
