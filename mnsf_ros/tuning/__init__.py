# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The best settings of the method online for recordings of one's own."""
