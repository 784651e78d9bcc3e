# Everything runs in .venv, which the first target that needs it creates.
# PYTHON picks the interpreter (3.11 or newer), e.g. make test PYTHON=python3.12

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

# Small matrices gain nothing from more threads, and lose much where other programs run.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1

# Tests start many interpreters, which need not compile the package one after the other.
unexport PYTHONDONTWRITEBYTECODE

# Three workers for two cores, as tests in real time mostly wait. Each file stays in one worker,
# in the order of tests/conftest.py: what compiles longest first.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder
QUICK := -m "not slow and not cluster and not gpu"

.PHONY: setup evaluate reports prepared check test slow test-clients test-cluster test-gpu lint docs release
.PHONY: demo test-demo clean
.DELETE_ON_ERROR:

# Install the package in place with what `softrobot evaluate` and `render` need.
setup: .venv/.setup

# Run all policies on all tasks; table on the terminal, report and plots in out/evaluate.
evaluate: .venv/.setup
	$(BIN)/softrobot evaluate --overwrite

# Measure anew what reports are older than their code, or of unknown age, the cheapest first:
# all of them, or make reports REPORTS="sections thesis". Run times ask for a machine of their own.
reports: .venv/.setup-test
	commands=$$($(BIN)/python scripts/figures.py --stale $(REPORTS)) && \
	  PATH="$(abspath $(BIN)):$$PATH" sh -exc "$$commands"
	$(BIN)/python scripts/figures.py

# Make the integrator's LLVM code anew that comes with the package, after an edit of its sources.
prepared: .venv/.setup-test
	$(BIN)/python scripts/prepared.py

# The daily loop: lint, and the tests that were quick when they were last run.
check: lint
	$(PYTEST) --quick $(QUICK)

# What failed is run again with the values in its assertions: to prepare all of them for that takes
# each worker ten seconds.
test: .venv/.setup-test
	$(PYTEST) --assert=plain $(QUICK) || { $(PYTEST) --last-failed --lfnf=none $(QUICK); exit 1; }

# What takes minutes: trainings, ANCF, Cosserat as a plant, whole studies, the wheel, and every
# benchmark's quick run.
slow: .venv/.setup-test
	$(PYTEST) -m slow

# Other libraries with our environments, each in a virtual environment of its own under
# .venv/clients; CLIENTS="torchrl skrl" picks some. Prints the table of docs/clients.md, which is made
# from its report: OUT=docs/results/clients writes it.
test-clients: .venv/bin/python
	$(BIN)/python tests/clients/run.py $(CLIENTS) $(if $(OUT),--out $(OUT))

# Studies, trainings and a search on a Ray cluster of two nodes of this machine; one is killed.
test-cluster: .venv/.setup-test
	$(PIP) install --quiet -c constraints.txt -e '.[cluster]'
	$(BIN)/python -m pytest tests/cluster

# Robots on MuJoCo Warp against the C engine, on Warp's CPU device: no graphics card is needed. Its
# kernels are compiled in the first run, which takes a minute or two more.
test-gpu: .venv/.setup-test
	$(PIP) install --quiet -c constraints.txt -e '.[gpu]'
	$(BIN)/python -m pytest tests/gpu

# The documentation site in out/docs; warnings, which broken links are, end it.
docs: .venv/.setup-docs
	$(BIN)/python scripts/figures.py --check
	$(BIN)/python -m sphinx -q -W --keep-going -b html -d out/doctrees docs out/docs

# The page with robots in the browser, at http://localhost:8000; needs Node.js.
demo: docs/demo/node_modules
	npm start --prefix docs/demo

# Its robots move as they do in Python, and the page works in headless Chromium if that is there.
test-demo: .venv/.setup docs/demo/node_modules
	mkdir -p out/demo
	$(BIN)/python scripts/demo.py --check
	$(BIN)/python scripts/demo.py --motions out/demo/motions.json
	node docs/demo/test/parity.js out/demo/motions.json
	node docs/demo/test/screenshot.js out/demo

docs/demo/node_modules: docs/demo/package-lock.json
	npm ci --no-audit --no-fund --prefix docs/demo
	touch $@

# Distributions in dist/, checked, and used in environments of their own, see scripts/release.py.
release: .venv/.setup-test
	$(BIN)/python scripts/release.py

lint: .venv/.setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

.venv/bin/python:
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "needs Python 3.11 or newer"'
	$(PYTHON) -m venv .venv

.venv/.setup: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) install -c constraints.txt -e '.[viz,mpc,robot]'
	touch $@

.venv/.setup-test: .venv/.setup
	$(PIP) install -c constraints.txt -e '.[viz,rl,mpc,robot,can,camera,recordings,test]'
	touch $@

.venv/.setup-docs: .venv/.setup
	$(PIP) install --quiet -c constraints.txt -e '.[docs,viz,rl,mpc,robot,recordings]'
	touch $@

clean:
	rm -rf .venv out dist build docs/api
