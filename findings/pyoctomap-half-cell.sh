#!/usr/bin/env bash
# SUBJECT  pyoctomap 1.2.2 (OctoMap for Python), with numpy 2.4.6
# GUESS    extractPointCloud returns the centres of occupied voxels, as the leaf iterator does.
# SEEN     For a leaf of the finest level it returns the upper corner, half a cell off on each
#          axis: the voxel at (10.25, -3.25, 1.25) with cells of 0.5 m is returned as
#          (10.5, -3.0, 1.5). Leaves that were merged from eight children are returned as the
#          right eight centres. So one cloud mixes both, and its error depends on what was pruned.
# WHY IT MATTERS
#          A map of 0.2 m cells is shifted by 0.17 m in places: more than the residual of a good
#          registration, enough to make static points look dynamic in a map comparison. Use the
#          leaf iterator and getCoordinate.
# SOURCE   Run below; OcTree.extractPointCloud, OcTree.begin_leafs.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 140 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pyoctomap==1.2.2 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pyoctomap

print("pyoctomap", version("pyoctomap"), "numpy", np.__version__)


def maps(cell, centres):
    tree = pyoctomap.OcTree(cell)
    for centre in centres:
        for _ in range(10):  # until all reach the same, largest, probability
            tree.updateNode(np.array(centre), True)
    tree.updateInnerOccupancy()
    leaves = [(leaf.getCoordinate(), leaf.getSize()) for leaf in tree.begin_leafs()]
    occupied, _ = tree.extractPointCloud()
    print(f"cells of {cell} m: leaves (centre, size) {leaves}, extracted {occupied.tolist()}")
    return leaves, occupied


for cell, centre in ((0.5, (10.25, -3.25, 1.25)), (1.0, (2.5, 2.5, 2.5))):
    leaves, occupied = maps(cell, [centre])
    assert len(leaves) == len(occupied) == 1
    assert np.allclose(leaves[0][0], centre), "the iterator gives no centres now"
    shift = occupied[0] - centre
    assert np.allclose(shift, cell / 2, atol=1e-5), f"shift is {shift} now"

eight = np.array(list(np.ndindex(2, 2, 2))) + 0.5
leaves, occupied = maps(1.0, eight)
assert len(leaves) == 1 and np.isclose(leaves[0][1], 2.0), "children are not merged now"
assert np.allclose(sorted(occupied.tolist()), sorted(eight.tolist())), "merged leaves changed"
print("as stated: single leaves are shifted by half a cell, merged ones are not")
EOF
