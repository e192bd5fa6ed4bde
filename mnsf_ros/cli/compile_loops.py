# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compiles all loops for this computer: `python -m mnsf_ros.cli.compile_loops`.

The installation does so, so that the first start of a program takes no longer than later ones.
"""
