# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compiles all loops for this computer: `python -m mnsf_ros.cli.compile_loops`.

The installation does so, so that the first start of a program takes no longer than later ones.
"""

import mnsf_ros.drawing.color_wheel
import mnsf_ros.methods
import mnsf_ros.sweeps_io.flow_columns  # noqa: F401 - to import is to compile
