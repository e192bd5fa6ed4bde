# The node in ROS 2 Jazzy, for x86-64 and arm64.
#   docker build --tag mnsf_ros .
#   docker run --rm --network host --ipc host mnsf_ros points:=/lidar/points
FROM ros:jazzy-ros-base
WORKDIR /workspace
COPY . src/mnsf_ros
RUN src/mnsf_ros/.ci/install_system_packages
RUN ["/bin/bash", "-c", "source /opt/ros/jazzy/setup.bash && src/mnsf_ros/.ci/build_workspace ."]
# The loops are compiled for the computer that built the image; another one compiles at its start.
ENTRYPOINT ["/bin/bash", "-c", "source install/setup.bash && exec ros2 launch mnsf_ros scene_flow.launch.py \"$@\"", "launch"]
