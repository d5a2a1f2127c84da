# Everything runs from a virtual environment in .venv; nothing needs root, and nothing outside this directory changes.
#   make demo         train and evaluate on a small budget
#   make test         lint, types, import rules and the default tests
#   make test-slow    the tests that the default run leaves out (more mutated files and aircraft states:
#                     FUZZ_ROWS=100000; more plans of random aircraft: FUZZ_PLANS=10000; more aircraft with fields
#                     unknown: FUZZ_SCENES=10000)
#   make test-compiled  the default tests of what decides in the air, by compiled code
#   make test-long    those of them that take minutes each, before a release
#   make format       rewrite the sources in the house format
#   make proofs       check the mathematics behind SAFE (needs coq, coquelicot, gappa)
#   make docs         build the documentation site into site/ (the build needs no network)
#   make ros          add ROS 2 and our interfaces to the environment (Linux on x86-64; needs g++)
#   make bluesky      make an environment in .bluesky with BlueSky and BlueSky-Gym
#   make constraints  resolve all dependencies anew (needs uv)
#   make clean        remove the environment and caches, keep runs/

# Python keeps what it compiles whatever the user has set: programs that tests start would else compile it each time.
unexport PYTHONDONTWRITEBYTECODE

PYTHON ?= python3
PYTEST_ARGS ?= -n 2 --dist loadfile --no-loadscope-reorder
UV ?= uv
# The tests that reach compiled code.
COMPILED := $(addprefix tests/agents/,assurance kernel planner check/test_flight.py test_check.py test_inference.py)

BIN := .venv/bin
PROJECT := pyproject.toml constraints/build.in
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check
COMPILE := $(UV) pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --no-emit-index-url

.PHONY: help demo test test-slow test-compiled test-long lint style types tests format proofs docs venv venv-run ros bluesky constraints clean

help:
	@sed -n 's/^#   //p' Makefile

# The interpreter is checked before anything is created, and a half-made environment is not left behind.
.venv/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "This project needs Python 3.11 or newer, and '$(PYTHON)' is not: name one with 'make PYTHON=python3.12 ...'." >&2; exit 1; }
	@$(PYTHON) -m venv .venv || { rm -rf .venv; \
	  echo "'$(PYTHON)' cannot create virtual environments: on Debian and Ubuntu install python3-venv." >&2; exit 1; }
	@touch $@

# The development set contains the running set with the same versions, so either stamp serves `make demo`.
.venv/run.stamp: .venv/pyvenv.cfg constraints/run.txt pyproject.toml
	@if [ -e .venv/dev.stamp ] && [ .venv/dev.stamp -nt constraints/run.txt ] && [ .venv/dev.stamp -nt pyproject.toml ]; then :; else \
	  echo "installing the dependencies into .venv" && \
	  $(PIP_INSTALL) --require-hashes -r constraints/run.txt && \
	  $(PIP_INSTALL) --no-deps --no-build-isolation --editable .; fi
	@touch $@

.venv/dev.stamp: .venv/pyvenv.cfg constraints/dev.txt pyproject.toml
	@echo "installing the dependencies for development into .venv"
	@$(PIP_INSTALL) --require-hashes -r constraints/dev.txt
	@$(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	@touch $@

venv-run: .venv/run.stamp

venv: .venv/dev.stamp

# One source distribution is among the wheels, so the build tools of the set above are used and none are fetched.
.venv/ros.stamp: .venv/dev.stamp constraints/ros.txt $(wildcard ros_bridge/rlcas_msgs/*.* ros_bridge/rlcas_msgs/*/*)
	@[ "$$(uname -sm)" = "Linux x86_64" ] || { \
	  echo "There are no ROS wheels for $$(uname -sm): use a ROS installation and colcon (docs/howto/ros.md)." >&2; exit 1; }
	@command -v $${CXX:-g++} >/dev/null || { \
	  echo "'make ros' compiles the interfaces and needs g++: on Debian and Ubuntu install g++." >&2; exit 1; }
	@echo "installing ROS 2 into .venv"
	@$(PIP_INSTALL) --no-build-isolation --require-hashes -r constraints/ros.txt
	@$(BIN)/python -m ros_bridge.build_interfaces
	@touch $@

ros: .venv/ros.stamp

# BlueSky-Gym needs an older numpy than the rest; what decides in it needs numpy and safetensors alone.
.bluesky/stamp: pyproject.toml
	@echo "installing BlueSky into .bluesky"
	@$(PYTHON) -m venv .bluesky
	@.bluesky/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[bluesky]'
	@touch $@

bluesky: .bluesky/stamp

# A second demo goes to a directory of its own.
demo: venv-run
	@out=runs/demo; if [ -e "$$out" ]; then out="runs/demo-$$(date +%Y%m%d-%H%M%S)"; fi; \
	  $(BIN)/python -m rlcas_jax.train --config configs/quick.yaml --out "$$out/train" && \
	  $(BIN)/python -m eval.monte_carlo --policy "$$out/train/policy.safetensors" --encounters 10000 --out "$$out/evaluation"

lint: style types

style: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo --no-cache

types: venv
	$(BIN)/basedpyright

# Types are checked, by one processor, while the first tests run.
test: style
	@$(MAKE) --no-print-directory --jobs 2 types tests

# Interpreted: compiling takes a minute whenever a source has changed, and the run of compiled code is another.
tests: venv
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest $(PYTEST_ARGS)

test-slow: venv
	$(BIN)/python -m pytest $(PYTEST_ARGS) -m "slow and not long"

test-compiled: venv
	$(BIN)/python -m pytest $(PYTEST_ARGS) --compiled $(COMPILED)

test-long: venv
	$(BIN)/python -m pytest $(PYTEST_ARGS) -m long

format: venv
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

proofs:
	@command -v coqc >/dev/null && command -v gappa >/dev/null || { \
	  echo "'make proofs' needs Coq and Gappa: on Debian and Ubuntu install coq, libcoq-coquelicot and gappa." >&2; exit 1; }
	@$(MAKE) --no-print-directory -C proofs

docs: venv
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo "site/index.html"

# Versions move only on `make constraints UPGRADE=--upgrade`.
constraints:
	$(COMPILE) --generate-hashes $(UPGRADE) --extra train --extra fast --extra sim --extra report --extra tensorboard \
	  $(PROJECT) -o constraints/run.txt
	$(COMPILE) --generate-hashes $(UPGRADE) --extra train --extra fast --extra sim --extra report --extra tensorboard --extra onnx \
	  --extra sweep --extra cluster --extra docs --extra dev -c constraints/run.txt $(PROJECT) -o constraints/dev.txt
	$(COMPILE) --generate-hashes $(UPGRADE) --extra ros -c constraints/dev.txt $(PROJECT) -o constraints/ros.txt
	$(COMPILE) --no-annotate $(UPGRADE) --extra peers -c constraints/run.txt pyproject.toml -o constraints/peers.txt
	@{ echo "# Versions without hashes: torch is built anew for each platform and processor (CPU builds carry a local"; \
	  echo "# version such as +cpu), so one list of hashes would refuse most of them. Use it to constrain an install:"; \
	  echo "#    pip install -c constraints/peers.txt '.[peers]'"; \
	  cat constraints/peers.txt; } > constraints/peers.tmp && mv constraints/peers.tmp constraints/peers.txt

clean:
	rm -rf .venv .bluesky build dist site *.egg-info .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
