# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Input check: what the method assumes about its input, measured on the stream."""
