# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Slow, obvious geometry that the simulator is compared with."""

import numpy as np

from mnsf_ros.simulation.bodies import ShapeKind


def signed_distance(kind, half, points):
    """Distance of (N, 3) local points to the surface of a shape, negative inside."""
    if kind == ShapeKind.SPHERE:
        return np.linalg.norm(points, axis=1) - half[0]
    if kind == ShapeKind.CYLINDER:
        radial = np.hypot(points[:, 0], points[:, 1]) - half[0]
        beyond = np.stack([radial, np.abs(points[:, 2]) - half[2]], axis=1)
    else:
        beyond = np.abs(points) - np.asarray(half)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)


def corners(poses, length, width):
    """(T, 4, 2) corners of a rectangle at (T, 3) x, y, yaw."""
    local = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * (length / 2, width / 2)
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=1)
    return np.einsum("tij,kj->tki", turn, local) + poses[:, None, :2]


def overlap(one, other):
    """(T,) whether two rectangles, (T, 4, 2) corners each, overlap: separating axis theorem."""
    apart = np.zeros(len(one), dtype=bool)
    for rectangle in (one, other):
        for edge in (0, 1):
            axis = rectangle[:, edge + 1] - rectangle[:, edge]
            a, b = (np.einsum("tkj,tj->tk", r, axis) for r in (one, other))
            apart |= (a.max(1) < b.min(1)) | (b.max(1) < a.min(1))
    return ~apart
