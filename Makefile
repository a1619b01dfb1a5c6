# Each target does all set-up itself; a second run starts at once.
BIN := .venv/bin
READY := .venv/ready
PEERS := .venv/peers
DEMO := .venv/demo
# `make test-all COVERAGE=` counts no lines, and takes a quarter less of the processor in tests of plain Python.
COVERAGE := --cov=carlaloc_env --cov=recorder --cov-report=

.PHONY: setup demo sample docs test test-long test-all check bench findings soak clean

setup: $(READY)

$(READY): PACKAGES := --editable ".[slam,report,compact]" --group dev
# As README installs; the tools of tests would take as long again.
$(DEMO): PACKAGES := --editable ".[slam,report]"

$(READY) $(DEMO): pyproject.toml .ci/system-libraries
	@python=$$(PYTHON="$(PYTHON)" .ci/find-python) && PYTHON="$$python" .ci/system-libraries && \
		if [ "$$python" != $(BIN)/python ]; then "$$python" -m venv --clear .venv; fi
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile $(PACKAGES)
	@touch $@

# What long tests compare with: as large as all other tools.
$(PEERS): $(READY)
	$(BIN)/python -m pip install --quiet --no-compile --group peers
	@touch $@

.venv/warm: $(READY)
	$(BIN)/python tests/warm_up.py
	@touch $@

demo: $(or $(wildcard $(READY)),$(DEMO))
	$(BIN)/carlaloc demo --out out/demo

# Two seconds of the demo's drive under six conditions, for people to look at before they install anything.
sample: $(READY)
	rm -rf out/sample out/sample.tar
	$(BIN)/carlaloc replay recorder/demo/town03.mcap --out out/sample --start 18 --duration 2 --rig .ci/sample.yaml \
		--weather ClearNoon,FoggyNoon,RainyNight --traffic static,dynamic --topics compact --format rosbag2
	tar -cf out/sample.tar -C out sample
	test $$(wc -c <out/sample.tar) -le 20000000

docs: $(READY)
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/python -m mkdocs build --strict

# Tests start hundreds of processes: each reads compiled sources, whatever the shell says of writing them.
test test-long test-all: export PYTHONDONTWRITEBYTECODE =
PYTEST := $(BIN)/python -m pytest -rs -n 2 --dist loadscope --no-loadscope-reorder

# What a change breaks first.
test: .venv/warm
	$(PYTEST) -m "not soak and not long"

# The rest of `make test-all`.
test-long: .venv/warm $(PEERS)
	$(PYTEST) -m "long and not soak"

test-all: .venv/warm $(PEERS)
	$(PYTEST) -m "not soak" $(COVERAGE)
	@[ -z "$(COVERAGE)" ] || echo "coverage: $$($(BIN)/python -m coverage report --format=total) % of lines"

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/prose.py
	$(BIN)/python .ci/modules.py
	@$(BIN)/python .ci/code_lines.py
	$(BIN)/python .ci/audit.py

bench: $(PEERS)
	$(BIN)/python benchmarks/$(if $(AGAINST),against.py $(AGAINST),run.py)

findings: $(READY)
	$(BIN)/python docs/findings/findings.py --work out/findings

soak: $(PEERS)
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/python -m pytest -m soak

clean:
	rm -rf .venv .qc .foxglove .nuscenes .coverage out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
