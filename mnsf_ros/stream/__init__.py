# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
