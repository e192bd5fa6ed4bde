# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings of the method online fitted to the user's own recordings."""
