# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid transforms, poses in messages and along a recording, and the flow of rigid motions."""
