# Everything runs in .venv, which the first target that needs it creates.
# PYTHON picks the interpreter (3.11 or newer), e.g. make test PYTHON=python3.12

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

.PHONY: setup evaluate test lint clean
.DELETE_ON_ERROR:

# Install the package in place with what `softrobot evaluate` and `render` need.
setup: .venv/.setup

# Run all policies on all tasks; table on the terminal, report and plots in out/evaluate.
evaluate: .venv/.setup
	$(BIN)/softrobot evaluate

# Files stay together, so that each beam model is compiled in one worker only.
test: .venv/.setup-test
	$(BIN)/python -m pytest -n 2 --dist loadfile

lint: .venv/.setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

.venv/bin/python:
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "needs Python 3.11 or newer"'
	$(PYTHON) -m venv .venv

.venv/.setup: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) install --quiet -c constraints.txt -e '.[viz,mpc,robot]'
	touch $@

.venv/.setup-test: .venv/.setup
	$(PIP) install --quiet -c constraints.txt -e '.[viz,rl,mpc,robot,test]'
	touch $@

clean:
	rm -rf .venv out dist build
