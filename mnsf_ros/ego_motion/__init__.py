# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How the sensor itself moved from sweep to sweep."""
