# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Animations of recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mnsf_ros.cli.main import run
from mnsf_ros.drawing.street_picture import ShownObject, street_picture
from mnsf_ros.errors import RecordingError
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.view.animation import save_animation

SMALL = SimulationSettings(num_beams=16, num_columns=360, duration_s=0.5)


def test_the_command_writes_one_picture_for_each_flow(tmp_path: Path) -> None:
    write_recording(SMALL, tmp_path / "street")
    path = tmp_path / "new" / "street.webp"
    assert run(["view", str(tmp_path / "street"), "--animation", str(path)]) == 0
    with Image.open(path) as image:
        assert (image.format, image.n_frames, image.size) == ("WEBP", 3, (880, 470))


def test_without_sweeps_there_is_no_animation(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no sweep"):
        save_animation([], tmp_path / "none.webp")
    assert not (tmp_path / "none.webp").exists()


def test_a_node_is_not_animated(capsys) -> None:
    assert run(["view", "--animation", "x.webp"]) == 2
    assert "needs a recording" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["x.gif", "x", "x.webp.mp4"])
def test_only_webp_is_written(tmp_path: Path, capsys, name: str) -> None:
    path = tmp_path / name
    assert run(["view", str(tmp_path), "--animation", str(path)]) == 2
    assert "expected the name of a .webp file" in capsys.readouterr().err
    assert not path.exists()


def test_labels_avoid_each_other_and_those_of_the_nearest_are_shown() -> None:
    nothing = np.zeros((0, 3), np.float32)

    def shown(*centers: tuple[float, float, float]) -> np.ndarray:
        boxes = [
            ShownObject(np.array(at), np.ones(3), 0.0, np.full(3, at[0]), nothing) for at in centers
        ]
        return np.asarray(street_picture(nothing, nothing, boxes, 15.0)).astype(int)

    def ink(picture: np.ndarray) -> int:
        return int((picture[:350, :, :].min(axis=2) > 200).sum())

    near, far, aside = (10.0, 0.0, 0.0), (10.5, 0.1, 0.0), (10.0, 8.0, 0.0)
    one = ink(shown(near))
    assert one > 20
    # Above, below, and no place for the third one.
    two = ink(shown(near, far))
    assert 1.3 * one < two < 2.2 * one
    third = (10.2, 0.05, 0.0)
    assert ink(shown(near, third, far)) <= 1.1 * two
    assert (shown(far, third, near) == shown(near, third, far)).all()
    assert ink(shown(near, aside)) > 1.3 * one


def test_only_what_moves_is_coloured() -> None:
    """Two walls, of which the left one moves ahead, which is red; a box behind the camera."""
    z, y = np.meshgrid(np.linspace(-1, 2, 60), np.linspace(2, 6, 60))
    left = np.column_stack([np.full(y.size, 10.0), y.ravel(), z.ravel()])
    xyz = np.vstack([left, left * [1, -1, 1]]).astype(np.float32)
    velocity = np.zeros_like(xyz)
    velocity[: len(left), 0] = 15.0
    behind = ShownObject(
        np.array([-60.0, 0, 0]), np.ones(3), 0.0, np.ones(3), np.zeros((2, 3), np.float32)
    )
    pixels = np.asarray(street_picture(xyz, velocity, [behind], 15.0)).astype(int)[:, :700]
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 60) & (pixels[..., 2] < 60)
    columns = np.flatnonzero(red.any(axis=0))
    assert red.sum() > 300
    assert columns.max() < 440
    grey = np.ptp(pixels[:, 450:700], axis=2)
    assert grey.max() < 40
