# `make demo` shows the node at work, `make test` runs the tests. Each sets up what it needs in
# .venv, once.
#   make demo BAG=path/to/recording POINTS=/one/of/several VIEW_OPTIONS='--port 8767'
# With a sourced ROS 2 its rclpy is used; without one, the wheels from PyPI.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What the node and its views need; and what the tests and the networks need besides.
READY := $(VENV)/ready
COMPLETE := $(VENV)/complete
ADDED := datasets,tune,test,lint

ifdef ROS_DISTRO
VENV_OPTIONS := --system-site-packages
EXTRAS := evaluation
# ROS is built with NumPy 1 and the libraries of the distribution.
SYSTEM_PINS := -e 's/^numpy==.*/numpy<2/' -e '/^scipy==/d' -e '/^matplotlib==/d'
else
EXTRAS := wheels,evaluation
endif

# PyTorch's own index has torch without CUDA; that of the default index takes gigabytes.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
TORCH := $(shell sed -n 's/^\(torch==[0-9.]*\).*/\1/p' constraints.txt)
PIP := $(BIN)/python -m pip --disable-pip-version-check
# Modules are compiled when they are first imported: most of these never are.
INSTALL := $(PIP) install --no-compile --constraint $(VENV)/constraints.txt --editable

STREET := street

# What `make pins` checks the pins for; Ubuntu 22.04 has glibc 2.35.
PYTHONS := 3.10 3.11 3.12 3.13 3.14
WHEELS_ONLY = --quiet --only-binary :all: --no-binary empy --python-version $$python

.PHONY: help setup complete demo view picture test test-all fuzz lint pins audit benchmark benchmark-online benchmark-movers config clean

help: ## lists these
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12

setup: $(READY) ## installs the node and its views into .venv: 0.8 GB

complete: $(COMPLETE)

$(READY): setup.py constraints.txt
	$(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)
	@echo "installing 0.8 GB into $(VENV)"
	sed -e '/^\#/d' $(SYSTEM_PINS) constraints.txt > $(VENV)/constraints.txt
	$(INSTALL) '.[$(EXTRAS)]'
	$(BIN)/python -m mnsf_ros.cli.compile_loops
	touch $@

# Where that index cannot be reached, torch comes from the default one if it is without CUDA there.
$(COMPLETE): $(READY)
	@if command -v nvidia-smi || \
		$(PIP) install --no-deps --retries 1 --index-url $(TORCH_INDEX) $(TORCH) || \
		{ needed=$$($(PIP) install --dry-run $(TORCH)) && ! echo "$$needed" | grep nvidia; }; \
	then networks=networks,; else echo "PyTorch is left out: $(TORCH_INDEX) cannot be reached," \
		"and elsewhere it takes 5.8 GB. Tests of networks are skipped. Later: rm $@; make complete"; \
	fi; $(INSTALL) ".[$(EXTRAS),$${networks}$(ADDED)]"
	touch $@

ifneq ($(BAG),)
$(if $(shell test -e '$(BAG)' && echo yes),,$(error BAG=$(BAG): no such recording; give its path))
endif

# A simulated street, or BAG, through the live node, whose flow is on a page for a browser. In a
# domain of ROS of its own, away from robots, whatever ROS_DOMAIN_ID says. All of it ends with the
# first part that does.
demo: SHELL := bash
demo: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
demo: export ROS_DOMAIN_ID := $(or $(DOMAIN),$(shell shuf -i 1-101 -n 1))
demo: $(READY) $(if $(BAG),,$(STREET)) ## a simulated street, or BAG=recording, through the live node, on a page; its ROS domain: DOMAIN=
	@trap 'kill $$play $$node $$view 2> /dev/null; wait' EXIT; trap exit HUP INT TERM; \
	$(BIN)/mnsf play '$(or $(BAG),$(STREET))' --loop --wait & play=$$!; \
	$(BIN)/scene_flow_node --ros-args --log-level warn \
		$(if $(POINTS),-r '~/points:=$(POINTS)') & node=$$!; \
	$(BIN)/mnsf view $(VIEW_OPTIONS) & view=$$!; \
	wait -n

# The same on the page alone, to play, pause and step.
view: $(READY) $(if $(BAG),,$(STREET)) ## the same without the node, to pause and step
	$(BIN)/mnsf view '$(or $(BAG),$(STREET))' $(if $(POINTS),--points '$(POINTS)') $(VIEW_OPTIONS)

$(STREET): | $(READY)
	$(BIN)/mnsf simulate --duration-s 6 --seed 0 $@

# The pictures of the street and of the page; needs Chromium.
picture: $(COMPLETE) $(STREET)
	$(BIN)/python tests/view/page_pictures.py $(STREET) 3.4 docs

# On all cores. TEST_OPTIONS="tests/online -k tracks" runs some of them, TEST_OPTIONS="-n 0" one
# after the other.
TEST := ROS_PYTHON_CHECK_FIELDS=1 $(BIN)/python -m pytest -n auto --dist loadfile

test: $(COMPLETE) ## the tests, in some minutes; installs PyTorch for the CPU, too
	$(TEST) -m 'not slow' $(TEST_OPTIONS)

# With kills, hostile files, locales and benchmarks.
test-all: $(COMPLETE) ## with slow tests
	$(TEST) $(TEST_OPTIONS)

# What readers of clouds, files and settings do with anything; FUZZ_EXAMPLES=100000 takes hours.
FUZZ_EXAMPLES ?= 5000
fuzz: $(COMPLETE)
	FUZZ_EXAMPLES=$(FUZZ_EXAMPLES) $(BIN)/python -m pytest tests/fuzzing $(TEST_OPTIONS)

lint: $(COMPLETE) ## style, types and layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Checks that every pin has a wheel for each supported Python, on x86-64 and arm64 (for which there
# are none of ROS), and writes all that a machine without ROS installs with hashes; needs PyPI.
pins: $(COMPLETE)
	$(PIP) install uv
	for python in $(PYTHONS); do \
		$(BIN)/uv pip compile $(WHEELS_ONLY) --python-platform x86_64-manylinux_2_35 \
			constraints.txt > /dev/null && \
		grep -v '^ros-' constraints.txt | $(BIN)/uv pip compile $(WHEELS_ONLY) \
			--python-platform aarch64-manylinux_2_35 - > /dev/null || exit; \
	done
	$(BIN)/uv pip compile --quiet --no-annotate --custom-compile-command 'make pins' \
		--universal --python-version 3.10 --constraint constraints.txt --generate-hashes \
		$(patsubst %,--extra %,wheels evaluation datasets tune) --output-file locked.txt setup.py

# Licences of all that is installed, and known vulnerabilities of what locked.txt installs, by
# PyPI's database.
audit: $(COMPLETE)
	$(PIP) install pip-audit pip-licenses
	$(BIN)/pip-licenses --from mixed --order license
	$(BIN)/pip-audit --strict --disable-pip --requirement locked.txt

# All methods on real sweeps; hours on a CPU. An interrupted run is continued.
benchmark: $(COMPLETE)
	nice $(BIN)/python benchmarks/paper_table.py --document docs/performance.md $(BENCHMARK_OPTIONS)

# Cost and latency of the method online; a quarter of an hour on two quiet cores.
benchmark-online: $(COMPLETE)
	for part in cost live; do \
		$(BIN)/python benchmarks/$$part.py --document docs/performance.md $(BENCHMARK_OPTIONS) || exit; \
	done

# How well movers are found and followed, against targets; some minutes.
benchmark-movers: $(COMPLETE)
	$(BIN)/python benchmarks/movers.py --document docs/performance.md $(BENCHMARK_OPTIONS)

# The files that are derived from mnsf_ros/settings.py; a test compares them.
config: $(READY)
	for preset in online mnsf paper authors; do \
		$(BIN)/mnsf parameters --preset $$preset > config/$$preset.yaml || exit; \
	done
	{ sed '/^| setting/,$$d' docs/parameters.md; $(BIN)/mnsf parameters --format markdown; } \
		> docs/parameters.new && mv docs/parameters.new docs/parameters.md

clean: ## removes .venv and the street
	rm -rf $(VENV) $(STREET) build install log *.egg-info
