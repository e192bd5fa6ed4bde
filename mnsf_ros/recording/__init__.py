# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading and writing recordings (bags), with or without the true flow."""
