# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Damaged and made-up files of every format: what is read, or one line that says why not."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.files import read_float_rows, read_npz

pytestmark = pytest.mark.slow
XYZ = np.arange(12, dtype=np.float32).reshape(4, 3)
# Where, how much is taken away, and what is put there instead.
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=9)), min_size=1, max_size=4
)


def edited(content, edits):
    for share, num_bytes, new in edits:
        place = round(share * len(content))
        content = content[:place] + new + content[place + num_bytes :]
    return content


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    """A small sweep in each format, by its name."""
    folder = tmp_path_factory.mktemp("sweeps")
    np.savez_compressed(folder / "sweep.npz", xyz=XYZ)
    (folder / "sweep.bin").write_bytes(np.hstack([XYZ, XYZ[:, :1]]).tobytes())
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


@given(st.data())
def test_a_damaged_sweep_is_read_or_refused_in_one_line(sweeps, tmp_path_factory, data):
    name = data.draw(st.sampled_from(sorted(sweeps)))
    file = tmp_path_factory.getbasetemp() / name
    file.write_bytes(edited(sweeps[name], data.draw(EDITS)))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            read_npz(file, ("xyz",)) if file.suffix == ".npz" else read_float_rows(file, 4)
    except DatasetError as error:
        assert "\n" not in str(error)
