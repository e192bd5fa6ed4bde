#!/usr/bin/env bash
# SUBJECT  kiss-slam 0.0.2 (lidar SLAM with an occupancy grid), with numpy 2.4.6
# GUESS    The map.yaml and map.png that it writes for ROS lie in the frame of its trajectory: its
#          keys are those of map_server, whose origin is the pose of the lower left pixel, x to the
#          right and y up.
# SEEN     Rows of the picture are x and columns are y, from the top. Loaded as map_server does, a
#          wall 5 m ahead that reaches from 8 m to the right to 8 m to the left lies 8 m to the
#          right and reaches from 0 to 16 m ahead: the map is turned by 90 degrees to the right,
#          and moved, since the origin is that of the map before turning.
# WHY IT MATTERS
#          The map looks right in any viewer, and a robot that loads it beside the trajectory, or
#          with goals in its frame, is localised nowhere or drives into walls. Turn the picture by
#          90 degrees to the left before it is used.
# SOURCE   Run below; OccupancyGridMapper.write_2d_occupancy_grid. The manual of nav2_map_server for
#          the meaning of origin, and REP 103 for the axes.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 PyYAML==6.0.4 pillow==13.0.0
pip --no-deps kiss-slam==0.0.2 kiss-icp==1.3.0
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version
from types import ModuleType, SimpleNamespace

import numpy as np
import yaml
from PIL import Image

# The mapper's module imports these for functions that are not called here (Open3D takes 450 MB).
for name, members in {"open3d": [], "kiss_slam.config": ["OccupancyMapperConfig"]}.items():
    sys.modules[name] = ModuleType(name)
    for member in members:
        setattr(sys.modules[name], member, None)
from kiss_slam.occupancy_mapper import OccupancyGridMapper  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("kiss-slam", "numpy")))
# Values of its configuration.
mapper = OccupancyGridMapper(
    SimpleNamespace(free_threshold=0.2, occupied_threshold=0.65, resolution=0.5, max_range=30.0,
                    z_min=0.1, z_max=0.5)
)
across, up = np.meshgrid(np.arange(-8, 8, 0.05), np.arange(0.2, 1.6, 0.1))
wall = np.column_stack([np.full(across.size, 5.02), across.ravel(), up.ravel()])
for _ in range(10):
    mapper.integrate_frame(wall, np.eye(4))
mapper.compute_3d_occupancy_information()
mapper.compute_2d_occupancy_information()
mapper.write_2d_occupancy_grid(sys.argv[1])

info = yaml.safe_load(open(f"{sys.argv[1]}/map.yaml"))
picture = np.asarray(Image.open(f"{sys.argv[1]}/map.png"))


def occupied(picture):
    """Centres of the occupied cells in the map frame, as map_server places them."""
    row, column = np.nonzero(1 - picture / 255 > info["occupied_thresh"])
    cells = np.column_stack([column, picture.shape[0] - 1 - row]) + 0.5
    return np.array(info["origin"][:2]) + cells * info["resolution"]


def spread(points):
    return [(float(low), float(high)) for low, high in zip(points.min(0), points.max(0))]


print("wall    x, y", [(5.02, 5.02), (-8.0, 7.95)])
print("map     x, y", spread(occupied(picture)), info["origin"])
print("turned  x, y", spread(occupied(np.rot90(picture))))
assert info["negate"] == 0 and info["resolution"] == 0.5
(x_low, x_high), (y_low, y_high) = spread(occupied(picture))
assert y_low == y_high == -7.75 and x_high - x_low > 15, "axes are those of ROS now"
(x_low, x_high), (y_low, y_high) = spread(occupied(np.rot90(picture)))
assert x_low == x_high == 5.25 and (y_low, y_high) == (-7.75, 7.75)
print("as stated: the map is turned by 90 degrees against the trajectory")
EOF
