# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Methods of scene flow, by name."""

from mnsf_ros.methods.registry import make_method as make_method
from mnsf_ros.methods.registry import method_names as method_names
