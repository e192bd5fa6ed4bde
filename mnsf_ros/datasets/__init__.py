# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Public lidar data sets as streams of labelled sweeps, and their way into recordings."""
