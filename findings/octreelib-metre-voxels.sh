#!/usr/bin/env bash
# SUBJECT  octreelib 0.0.9 (grids and octrees of clouds for SLAM), with numpy 1.26.4
# GUESS    A grid with voxel_edge_length 0.5 has voxels of half a metre, as one with 1 has voxels of
#          a metre; each holds the points inside it; the grid begins at its corner.
# SEEN     Right with whole metres only. The corners of the voxels are cut to integers: with 0.5 m a
#          cube of 2 m has 8 voxels, not 64, and 7 of 8 points lie outside the cube of
#          the voxel that holds them. Cut towards zero: x = -0.4 and x = 0.6 share the voxel of
#          [0, 0.5]. The grid's own corner is subtracted and not added again: with corner (10, 10,
#          10) the point (10.2, 10.2, 10.2) is in a voxel at the origin.
# WHY IT MATTERS
#          Indoors and for fitting planes voxels are smaller than a metre. Points of two walls, or
#          of floor and shelf, get into one voxel, and a plane is fitted through both; number
#          of points and printed edge length look right. Scale the cloud, so that the edge is 1.
# SOURCE   Run below; insert_points in grid/grid.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.12. About 100 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==1.26.4
pip --no-deps octreelib==0.0.9
"$dir/venv/bin/python" - <<'EOF'
import sys
from importlib.metadata import version
from types import ModuleType

# For pictures and for RANSAC on a graphics card, which are not used here.
for name in ("k3d", "octreelib.ransac", "octreelib.ransac.cuda_ransac"):
    sys.modules[name] = ModuleType(name)
sys.modules["octreelib.ransac.cuda_ransac"].CudaRansac = None

import numpy as np  # noqa: E402
from octreelib.grid import Grid, GridConfig  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("octreelib", "numpy")))


def voxels_of(points, edge, corner=(0.0, 0.0, 0.0)):
    """Returns corner and points of each voxel of a new grid."""
    grid = Grid(GridConfig(voxel_edge_length=edge, corner=np.array(corner)))
    grid.insert_points(0, points)
    assert grid.n_points(0) == len(points)
    octrees = grid._Grid__octrees
    return [(voxel.corner_min, octrees[voxel].get_points(0)) for voxel in octrees]


def outside(voxels, edge):
    return sum(
        int(((points < corner) | (points >= corner + edge)).any(axis=1).sum())
        for corner, points in voxels
    )


middles = np.arange(16) / 8 + 1 / 16
cube = np.stack(np.meshgrid(middles, middles, middles), axis=-1).reshape(-1, 3)
for edge, expected in ((1.0, 8), (0.5, 64)):
    voxels = voxels_of(cube, edge)
    print(f"edge {edge} m: {len(voxels)} voxels (guess {expected}), "
          f"{outside(voxels, edge)} of {len(cube)} points outside their own")
    if edge == 1.0:
        assert len(voxels) == expected and outside(voxels, edge) == 0
    else:
        assert len(voxels) == 8, "voxels of half a metre are kept apart now"
        assert outside(voxels, edge) == len(cube) * 7 // 8

pair = np.array([[-0.4, 0.1, 0.1], [0.6, 0.1, 0.1]])
((corner, points),) = voxels_of(pair, 0.5)
print("voxel", corner, "holds x =", sorted(points[:, 0]))
assert sorted(points[:, 0]) == [-0.4, 0.6] and not corner.any()

((corner, points),) = voxels_of(np.full((1, 3), 10.2), 1.0, corner=(10.0, 10.0, 10.0))
print("grid from (10, 10, 10): voxel", corner, "holds", points[0])
assert not corner.any(), "the corner of the grid is added now"
print("as stated: voxels begin at whole metres")
EOF
