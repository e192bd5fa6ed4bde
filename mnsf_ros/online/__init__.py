# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method: ego motion, plus one motion per object. Start at `object_flow.py`.

docs/method.md names the file of each step, and where the constants come from.
"""
