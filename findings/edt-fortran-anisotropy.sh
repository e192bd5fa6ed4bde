#!/usr/bin/env bash
# SUBJECT  edt 3.1.2 (exact distance transform), with numpy 2.4.6
# GUESS    For a Fortran-ordered array, the cell sizes must be given in reverse: the docstring
#          says "you'll want to reverse the order of the anisotropic arguments".
# SEEN     The sizes belong to the axes of the array in either memory order. Following the
#          docstring gives distances that are wrong by up to 2.1 m in a grid of 4 m x 2 m x 4 m.
#          Values for the two orders differ only in the last bits, but they do differ.
# WHY IT MATTERS
#          Grids with a cell height unlike the cell width are common for lidar, and an array
#          becomes Fortran-ordered by a transpose. Only isotropic grids hide the mistake, and a
#          test that compares bits fails when the memory order changes.
# SOURCE   Run below; docstrings of edt.edt, edt.edtsq and edt.sdfsq in this version.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile edt==3.1.2 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import edt
import numpy as np

print("edt", version("edt"), "numpy", np.__version__)
assert "reverse the order" in " ".join(edt.edt.__doc__.split()), "the docstring has changed"

rng = np.random.default_rng(1)
free = rng.random((40, 10, 10)) > 0.002
free[0, 0, 0] = False
size = (0.1, 0.2, 0.4)

# Distances by comparing every cell with every occupied cell.
cells = np.argwhere(np.ones_like(free)) * size
occupied = np.argwhere(~free) * size
gaps = np.linalg.norm(cells[:, None] - occupied[None], axis=-1)
exact = gaps.min(axis=1).reshape(free.shape)

c_order = np.ascontiguousarray(free)
f_order = np.asfortranarray(free)
results = {
    "C order, sizes by axis": edt.edt(c_order, anisotropy=size),
    "Fortran order, sizes by axis": edt.edt(f_order, anisotropy=size),
    "Fortran order, sizes reversed": edt.edt(f_order, anisotropy=size[::-1]),
}
errors = {name: float(np.abs(got - exact).max()) for name, got in results.items()}
for name, error in errors.items():
    print(f"{name:30} largest error {error:.7f} m")
same_bits = np.array_equal(*list(results.values())[:2])
print("same bits in both memory orders:", same_bits)

assert errors["C order, sizes by axis"] < 1e-5
assert errors["Fortran order, sizes by axis"] < 1e-5, "sizes no longer belong to the axes"
assert errors["Fortran order, sizes reversed"] > 1.0, "reversed sizes are right now"
assert not same_bits, "both orders give the same bits now"
print("as stated: do not reverse the sizes")
EOF
