# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Other programs as methods: real scripts in real processes."""

import shlex
import sys
from dataclasses import replace

import numpy as np
import pytest
from moving_sweeps import QUICK, as_sweep

from mnsf_ros.errors import MethodError, SettingsError, SweepError
from mnsf_ros.methods import external_flow, make_method
from mnsf_ros.sweeps.sweep import SweepTriplet

START = "import sys, numpy as np; current, following, flow = sys.argv[-3:]\n"
# The flow of point i is its own position times the number of points of the next sweep.
NETWORK = START + (
    "points, number = np.load(current), len(np.load(following))\n"
    "assert points.dtype == np.float32\n"
    "np.save(flow, points * number)\n"
)


@pytest.fixture
def triplet():
    rng = np.random.default_rng(0)
    current, following = rng.uniform(2, 9, (20, 3)), rng.uniform(2, 9, (30, 3))
    return SweepTriplet(None, as_sweep(np.clip(current, None, 3.9)), as_sweep(following % 3.9, 1))


@pytest.fixture
def script(tmp_path):
    """Writes a program; its name has a space, as names of folders do."""

    def write(code):
        path = tmp_path / "a network.py"
        path.write_text(code)
        return [sys.executable, str(path)]

    return write


def estimate(command, triplet):
    return make_method(f"command:{shlex.join(command)}", QUICK).estimate(triplet)


def test_flow_is_what_the_program_writes(script, triplet):
    result = estimate(script(NETWORK), triplet)
    np.testing.assert_array_equal(result.flow, triplet.current.xyz * np.float32(30))
    assert result.flow.dtype == np.float32
    assert result.kept.all()
    assert list(result.times_ms) == ["prepare", "command"]
    assert result.fits == {}


def test_exactly_the_points_that_count_are_given(script, triplet):
    asked = np.arange(20) % 2 == 0
    given = SweepTriplet(None, replace(triplet.current, kept=asked), triplet.next)
    result = estimate(script(NETWORK), given)
    assert result.kept.tolist() == asked.tolist()
    np.testing.assert_array_equal(result.flow[asked], triplet.current.xyz[asked] * np.float32(30))
    assert np.isnan(result.flow[~asked]).all()
    # Outside of the crop.
    more = np.vstack([[(300.0, 0.0, 0.0)], triplet.current.xyz])
    result = estimate(script(NETWORK), SweepTriplet(None, as_sweep(more), triplet.next))
    assert result.kept.tolist() == [False] + [True] * 20
    assert not result.flow[0].any()
    np.testing.assert_array_equal(result.flow[1:], triplet.current.xyz * np.float32(30))


def test_arguments_come_first_and_time_is_what_the_program_tells(script, triplet, tmp_path):
    code = START + (
        "import json; json.dump(sys.argv[1:-3], open(sys.argv[2], 'w'))\n"
        "np.save(flow, np.ones((20, 3), np.int64))\n"
        "print('time_ms: 3'); print('loading'); print('time_ms: 12.5'); print('bye')\n"
    )
    said = tmp_path / "said"
    result = estimate([*script(code), "--weights", str(said), "$HOME;"], triplet)
    assert (result.flow == 1).all()
    assert result.times_ms == {"network": 12.5}
    assert said.read_text() == f'["--weights", "{said}", "$HOME;"]'


@pytest.mark.parametrize("name", ["flot", "3dflow"])
def test_command_from_the_name_or_an_environment_variable(script, triplet, monkeypatch, name):
    variable = f"MNSF_{name.upper()}"
    monkeypatch.delenv(variable, raising=False)
    text = f"^method '{name}' runs the command in the environment variable {variable}, which is not"
    with pytest.raises(SettingsError, match=text):
        make_method(name, QUICK)
    python, path = script(NETWORK)
    monkeypatch.setenv(variable, f"{python} '{path}'")
    for each in (name, f"command:{python} '{path}' --device cpu"):
        assert make_method(each, QUICK).estimate(triplet).flow.any()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("", "expected a program"), ("  ", "expected a program"), ("a 'b", "No closing quotation")],
)
def test_command_line_that_is_none(text, complaint):
    with pytest.raises(SettingsError, match=complaint):
        make_method(f"command:{text}", QUICK)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("import sys; print('no GPU', file=sys.stderr); sys.exit(3)", "status 3: no GPU$"),
        ("raise ValueError('bad\\nweights')", "status 1: weights$"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "status -9: no output$"),
        ("", "wrote no flow.npy$"),
        (START + "open(flow, 'w').write('x' * 99)", "flow.npy cannot be read: "),
        (START + "np.save(flow, np.zeros((20, 3)).astype(object))", "flow.npy cannot be read: "),
        (
            START + "np.save(flow, np.zeros((19, 3)))",
            r"shape \(19, 3\) of float64, expected \(20, 3\)",
        ),
        (START + "np.save(flow, np.zeros((20, 3), complex))", r"of complex128, expected"),
        (START + "np.save(flow, np.eye(20, 3) / 0)", "20 of 20 rows of flow are not finite$"),
        (START + "np.save(flow, np.eye(20, 3) * 1e300)", "3 of 20 rows of flow are not finite$"),
    ],
)
def test_program_that_gives_no_flow(script, triplet, code, text):
    with pytest.raises(MethodError, match=text) as info:
        estimate(script(code), triplet)
    assert str(info.value).startswith(f"{sys.executable}: ")


def test_program_that_cannot_be_started(triplet, tmp_path):
    missing = [str(tmp_path / "missing")]
    with pytest.raises(MethodError, match=r"missing: cannot be started: No such file or dir"):
        estimate(missing, triplet)
    nothing = replace(triplet, current=as_sweep(np.zeros((0, 3))))
    with pytest.raises(SweepError, match="0 of 0 points are left"):
        estimate(missing, nothing)


def test_program_that_hangs_is_ended(triplet, monkeypatch):
    monkeypatch.setattr(external_flow, "_TIMEOUT_S", 0.5)
    with pytest.raises(MethodError, match=r"^/bin/sh: not done after 0.5 s$"):
        estimate(["/bin/sh", "-c", "exec sleep 3600"], triplet)
