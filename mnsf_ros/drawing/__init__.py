# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All pictures and charts: shared by the report, the page, the studies and the node."""
