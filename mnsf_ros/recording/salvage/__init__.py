# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading recordings that are damaged, cut short or without an index, as far as they are there."""
