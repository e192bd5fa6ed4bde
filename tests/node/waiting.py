# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How long the tests wait for what must happen."""

from __future__ import annotations

# Far more than a loaded machine needs: only a failing test waits that long.
PATIENCE_S = 300.0
