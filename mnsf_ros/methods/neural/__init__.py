# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's method at the rate of the sensor: small fields, only where something may move."""
