# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow field g(p; theta) of the live method: an encoding of the position, and a linear head.

The encoding of a point is a constant of its part, and the trilinear weights of the eight nodes
around it on a coarse grid of its part. The head is fitted to a target sweep by Gauss-Newton steps,
each solved by conjugate gradients: tens of milliseconds where a perceptron takes seconds.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.methods.neural.parts import Parts
from mnsf_ros.objects.target import Target

_NODE_SPACING_M: Final = 2.0
# Cells are numbered from here on: their numbers are not negative.
_FIRST_CELL: Final = -(2**15)
_CELLS_PER_AXIS: Final = 2**16
# Prior weights of a constant and of a node, in points: parts move nearly as a whole.
_CONSTANT_WEIGHT: Final = 1e-3
_NODE_WEIGHT: Final = 1.0
_NUM_STEPS: Final = 4
_NUM_CONJUGATE_STEPS: Final = 5
# A point this far from the target, plus twice its spacing, has half of its weight.
_HALF_WEIGHT_M: Final = 0.1
# The weight of a point that would be behind something.
_HIDDEN_WEIGHT: Final = 0.1
_SMALLEST: Final = 1e-20


class EncodedField:
    """Flow of the points of parts, as a linear head on their encoding."""

    def __init__(self, parts: Parts) -> None:
        """Encodes the points."""
        self._parts = parts
        nodes, weights = _nodes_around(parts)
        constants = parts.owners[:, None]
        columns = np.concatenate([constants, len(parts) + nodes], axis=1)
        values = np.concatenate([np.ones(constants.shape), weights], axis=1)
        ends = np.arange(0, columns.size + 1, columns.shape[1])
        self._encoding = csr_matrix((values.ravel(), columns.ravel(), ends))
        self._transposed = self._encoding.T.tocsr()
        self._prior: NDArray[np.float64] = np.full((self._encoding.shape[1], 1), _NODE_WEIGHT)
        self._prior[: len(parts)] = _CONSTANT_WEIGHT

    def fitted(self, target: Target, start: NDArray[np.float32]) -> NDArray[np.float32]:
        """Fits the head so that the points move onto a target: minimizes a robust D(p + g(p), S).

        Args:
            target: The target sweep S.
            start: (P, 3) metres until the target, to which the head adds.

        Returns:
            (P, 3) metres, the flow until the target.
        """
        parts, flow = self._parts, start
        places = transformed(parts.positions + start, target.from_current)
        _, is_hidden = target.sweep.view.free_and_hidden(places)
        visible = np.where(is_hidden, _HIDDEN_WEIGHT, 1.0)
        half_m = _HALF_WEIGHT_M + 2 * parts.spacing
        head: NDArray[np.float64] = np.zeros((len(self._prior), 3))
        for _ in range(_NUM_STEPS):
            pulls, distances, in_reach = parts.pulls(target, flow)
            weights = np.where(in_reach, visible / (1 + (distances / half_m) ** 2), 0.0)
            head = self._solved(weights[:, None], pulls + flow - start, head)
            flow = np.asarray(start + self._encoding @ head, np.float32)
        return flow

    def _solved(
        self, weights: NDArray[np.float64], wanted: NDArray[np.float64], head: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The head (F, 3) nearest to the wanted flow (P, 3), by weights (P, 1), from another."""
        squares = self._transposed.multiply(self._transposed) @ weights + self._prior

        def normal(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
            encoded = self._encoding @ vectors
            return np.asarray(self._transposed @ (weights * encoded) + self._prior * vectors)

        left = self._transposed @ (weights * wanted) - normal(head)
        direction = scaled = left / squares
        size = (left * scaled).sum(axis=0)
        for _ in range(_NUM_CONJUGATE_STEPS):
            product = normal(direction)
            step = size / np.maximum((direction * product).sum(axis=0), _SMALLEST)
            head, left = head + step * direction, left - step * product
            scaled = left / squares
            last, size = size, (left * scaled).sum(axis=0)
            direction = scaled + size / np.maximum(last, _SMALLEST) * direction
        return head


def _nodes_around(parts: Parts) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(P, 8) the nodes around each point, numbered from 0, and their trilinear weights."""
    places = parts.positions.astype(np.float64) / _NODE_SPACING_M
    cells = np.floor(places)
    inside = places - cells
    limit = _CELLS_PER_AXIS - 2
    corners = np.clip(cells - _FIRST_CELL, 0, limit).astype(np.int64)
    keys, weights = [], []
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (corners + corner).T
        keys.append(
            ((parts.owners * _CELLS_PER_AXIS + x) * _CELLS_PER_AXIS + y) * _CELLS_PER_AXIS + z
        )
        weights.append(np.where(corner, inside, 1 - inside).prod(axis=1))
    _, nodes = np.unique(np.stack(keys, axis=1), return_inverse=True)
    return nodes.reshape(-1, 8), np.stack(weights, axis=1)
