# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Install list of the package, for colcon (ament_python) and for pip."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.install import install

PACKAGE = "mnsf_ros"
HERE = Path(__file__).resolve().parent  # colcon links this file into its build folder
VERSION = re.search(r'__version__ = "(.+)"', (HERE / PACKAGE / "__init__.py").read_text())[1]


class InstallAndCompile(install):
    """As colcon does: the loops are compiled where the package lies, not at the first start."""

    def run(self) -> None:
        """Installs, and compiles, unless it is for another place, as in a wheel or a package."""
        super().run()
        if self.root is not None:
            return
        self.announce("compiling loops for this computer, half a minute", level=2)
        folder = str(Path(self.install_lib).resolve())
        paths = [folder, *filter(None, [os.environ.get("PYTHONPATH")])]
        compiled = subprocess.run(
            [sys.executable, "-m", f"{PACKAGE}.cli.compile_loops"],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        if compiled.returncode != 0:
            reason = compiled.stderr.strip().rpartition("\n")[2]
            self.warn(f"the first start will compile loops, half a minute: {reason}")


# The PyPI wheels of ROS 2 must never be a hard requirement: beside an installed ROS they would
# shadow it. They are an extra, for machines without ROS.
ROS_WHEELS = [
    "ros-jazzy-rclpy>=7.1,<8",
    "ros-jazzy-common-interfaces>=5.3,<6",
    "ros-rclpy[fastrtps]>=7.1,<8",
]

# For `mnsf evaluate`, `report` and `study`: rows, tables of errors, charts and the report.
EVALUATION = ["cattrs>=23.2", "Jinja2>=3.1", "matplotlib>=3.6", "pandas>=2.2"]

setup(
    name=PACKAGE,
    version=VERSION,
    description="Online lidar scene flow for ROS 2: the motion of every point, without a GPU",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    project_urls={"Paper": "https://arxiv.org/abs/2403.16116"},
    keywords=["lidar", "scene flow", "point cloud", "ROS 2", "moving objects"],
    author="The mnsf_ros developers",
    author_email="mnsf_ros@users.noreply.github.com",
    maintainer="The mnsf_ros developers",
    maintainer_email="mnsf_ros@users.noreply.github.com",
    python_requires=">=3.10",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 15)),
        "Topic :: Scientific/Engineering",
        "Topic :: Scientific/Engineering :: Image Processing",
        "Typing :: Typed",
    ],
    cmdclass={"install": InstallAndCompile},
    packages=find_packages(include=[f"{PACKAGE}*", "msg_utils*"]),
    package_data={
        PACKAGE: ["py.typed", "node/*.xml", "report/templates/*", "view/page/*"],
        "msg_utils": ["py.typed"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(map(str, Path("config").iterdir()))),
        (f"share/{PACKAGE}/launch", sorted(map(str, Path("launch").glob("*.launch.py")))),
        (f"share/{PACKAGE}/rviz", sorted(map(str, Path("rviz").glob("*.rviz")))),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "numba>=0.61",
        "rosbags>=0.11,<0.12",
        "mcap>=1.2,<2",
        "apsw>=3.44",
        "zstandard>=0.15",
        "ruamel.yaml>=0.17",
        'backports.zstd>=1; python_version < "3.14"',
        "rich>=13",
        "websockets>=13",
    ],
    extras_require={
        "wheels": ROS_WHEELS,
        "evaluation": EVALUATION,
        # For the methods with networks (mnsf, fnsf, nsfp); online does without.
        "networks": ["torch>=2.4", "edt>=2.4"],
        "datasets": ["pyarrow>=14", "h5py>=3.10"],
        "ray": [*EVALUATION, "ray>=2.40"],
        "tune": [*EVALUATION, "optuna>=5,<6"],
        "test": ["pytest>=7.4,<9", "pytest-xdist>=3.5", "hypothesis>=6.100", "pureini>=0.10"],
        "lint": ["ruff", "mypy", "import-linter>=2"],
        # What `make benchmark-online` compares the cost with.
        "benchmark": ["kiss-icp>=1.2,<2"],
    },
    entry_points={
        "console_scripts": [
            "mnsf = mnsf_ros.cli.__main__:main",
            "scene_flow_node = mnsf_ros.node.__main__:main",
            "scene_flow_lifecycle_node = mnsf_ros.node.__main__:lifecycle_main",
        ]
    },
    zip_safe=False,
)
