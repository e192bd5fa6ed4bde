"""`python -m mnsf_ros.cli` is the `mnsf` command."""

from mnsf_ros.cli.main import main

if __name__ == "__main__":
    main()
