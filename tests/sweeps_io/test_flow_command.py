# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf flow`, from files to a file."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.cli import flow
from mnsf_ros.cli.arguments import Arguments
from mnsf_ros.errors import SettingsError, SweepError, SweepFileError
from mnsf_ros.sweeps_io.sweep_files import read_points

FAST = [
    *("--preset", "paper"),
    *("--set", "optimization.max_iterations=5", "--set", "fusion.max_iterations=5"),
    *("--set", "field.hidden_width=16", "--set", "distance.kind=tree"),
    *("--set", "compute.device=cpu", "--set", "compute.num_threads=1"),
]


def run(*arguments):
    """Runs the subcommand with its arguments."""
    parser = argparse.ArgumentParser()
    flow.add_flow(Arguments(parser))
    flow.run_flow(parser.parse_args(list(map(str, arguments))))


@pytest.fixture
def files(tmp_path, make_scene):
    """Five sweeps in the order of time, each in another format."""
    scene = make_scene()
    np.save(tmp_path / "0.npy", scene.previous - 0.1)
    np.save(tmp_path / "1.npy", scene.previous)
    np.savez(tmp_path / "2.npz", pc1=scene.previous, pc2=scene.current)
    rows = np.hstack([scene.next, np.ones((len(scene.next), 1))])
    (tmp_path / "3.bin").write_bytes(rows.astype("<f4").tobytes())
    return [tmp_path / "0.npy", tmp_path / "1.npy", f"{tmp_path / '2.npz'}:pc2", tmp_path / "3.bin"]


def test_three_sweeps(files, tmp_path, capsys, make_scene):
    run(*files[1:], "-o", tmp_path / "out.npz", *FAST)
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    number = len(make_scene().current)
    assert said.startswith(f"{tmp_path / 'out.npz'}: {number} points, ")
    assert "; mnsf: flow " in said
    for stage in ("forward", "backward", "fusion"):
        assert f"{stage} iteration_limit after 5 steps" in said
    with np.load(tmp_path / "out.npz") as arrays:
        np.testing.assert_array_equal(arrays["xyz"], make_scene().current)
        assert np.isfinite(arrays["flow"]).all()
        assert 0 < arrays["kept"].sum() < number
        settings = json.loads(str(arrays["settings"]))
    assert settings["optimization.max_iterations"] == 5
    assert settings["early_stopping.patience"] == 10


def test_two_sweeps(files, tmp_path, capsys):
    run(*files[2:], "--out", tmp_path / "out.npz", *FAST)
    said = capsys.readouterr().out
    assert "forward" in said
    assert "backward" not in said
    run(*files[2:], "-o", tmp_path / "fnsf.npz", "--method", "fnsf", *FAST)
    flows = [read_points(f"{tmp_path / name}.npz:flow") for name in ("fnsf", "out")]
    np.testing.assert_array_equal(*flows)


def test_without_options_it_is_the_fast_method(tmp_path, capsys):
    street = BoxStreet()
    for number in range(3):
        car = (5 + 0.8 * number, 0)
        np.save(tmp_path / f"{number}.npy", street.xyz(pose(x=0.4 * number), number, cars=[car]))
    files = [tmp_path / f"{number}.npy" for number in range(3)]
    run(*files, "-o", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as arrays:
        velocity, dynamic, confidence = (
            arrays[name] for name in ("velocity", "dynamic", "confidence")
        )
    said = capsys.readouterr().out
    assert "; online: flow " in said
    assert "; ego motion: registration; " in said
    assert f", {dynamic.sum()} dynamic; " in said
    assert dynamic[-400:].mean() > 0.7  # what is nearest to the ground counts as ground
    assert dynamic[:-400].mean() < 0.01
    assert not velocity[dynamic == 0].any()
    # As there are no stamps, 0.1 s lie between the sweeps.
    np.testing.assert_allclose(np.median(velocity[-400:], axis=0), (8, 0, 0), atol=0.5)
    assert ((confidence >= 0) & (confidence <= 1)).all()
    run(*files, "-o", tmp_path / "slow.npz", "--interval-s", "0.2")
    with np.load(tmp_path / "slow.npz") as arrays:
        slow = np.median(arrays["velocity"][-400:], axis=0)
    np.testing.assert_allclose(slow, (4, 0, 0), atol=0.25)


def test_row_without_a_point_stays_a_row(files, tmp_path, capsys, make_scene):
    xyz = make_scene().current.copy()
    xyz[[0, 7]] = np.nan
    np.save(tmp_path / "holes.npy", xyz)
    run(tmp_path / "holes.npy", files[-1], "-o", tmp_path / "out.npz", *FAST)
    assert f": {len(xyz) - 2} points and 2 rows without, " in capsys.readouterr().out
    with np.load(tmp_path / "out.npz") as arrays:
        missing = np.isnan(arrays["flow"]).all(axis=1)
        assert np.flatnonzero(missing).tolist() == [0, 7]
        assert not arrays["kept"][missing].any()
        assert np.isfinite(arrays["flow"][~missing]).all()


THREE = ("1.npy", "2.npz:pc2", "3.bin")


@pytest.mark.parametrize(
    ("names", "arguments", "error", "text"),
    [
        (THREE[:1], [], SweepFileError, "^got 1 sweep, expected CURRENT and NEXT at least$"),
        (("none.npy", "1.npy"), [], SweepFileError, "^sweep 1 of 2 has no finite point$"),
        (("0.npy", "1.npy", "nan.npy"), [], SweepFileError, "^sweep 3 of 3 has no finite point$"),
        (THREE, ["--interval-s", "0"], SweepFileError, r"got 0 s, expected 0.001 to 60 s"),
        (THREE, ["--method", "ego"], SweepError, "the ego motion is not known"),
        (THREE, ["--method", "fnfs"], SettingsError, "unknown method 'fnfs'; did you mean fnsf"),
        (THREE, ["--set", "crop.max_range=3"], SettingsError, "unknown setting 'crop.max_range'"),
        (THREE, ["--set", "crop.max_range_m"], SettingsError, "NAME=VALUE"),
        (THREE, ["--set", "crop.max_range_m=far"], SettingsError, "'far', expected a number"),
        (THREE, ["--set", "crop.min_range_m=70"], SweepError, "points are left after crop"),
    ],
)
def test_what_cannot_be_used(files, tmp_path, names, arguments, error, text):
    np.save(tmp_path / "none.npy", np.zeros((0, 3)))
    np.save(tmp_path / "nan.npy", np.full((20, 3), np.nan))
    with pytest.raises(error, match=text):
        run(*(tmp_path / name for name in names), "-o", tmp_path / "out.npz", *arguments)
    assert not (tmp_path / "out.npz").exists()


def test_output_is_checked_before_the_work(files, tmp_path):
    (tmp_path / "out.npz").touch()
    for out, text in (
        (tmp_path / "out.npz", "exists already; --force replaces"),
        (tmp_path / "o.pcd", "ends with"),
    ):
        with pytest.raises(SweepFileError, match=text):
            run("missing.npy", "missing.npy", "-o", out)
    run(*files[2:], "-o", tmp_path / "out.npz", "--force", *FAST)
    assert read_points(f"{tmp_path / 'out.npz'}:flow").shape[1] == 3
