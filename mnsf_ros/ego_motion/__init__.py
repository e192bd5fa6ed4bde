# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Ego motion: the sensor's motion from sweep to sweep."""
