"""`python -m mnsf_ros.node` runs the scene flow node."""

from mnsf_ros.node.main import main

if __name__ == "__main__":
    main()
