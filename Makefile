# Two commands: `make tulip` identifies the TULip leg, `make test` proves the code. Both make .venv.
PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
RUN := $(VENV)/bin/python
# Matrices here are small: a second BLAS thread only waits, and takes the core of another process.
export OPENBLAS_NUM_THREADS := 1

.PHONY: tulip test lint docs env clean

tulip: env
	$(RUN) scripts/identify_tulip_leg.py

test: lint
	$(RUN) -m pytest -n 2 --dist worksteal

lint: env
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

docs: env
	$(RUN) -m sphinx --quiet --fail-on-warning --keep-going --nitpicky docs out/docs
	@echo "The documents: out/docs/index.html"

env: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and "seaid needs Python 3.11 or newer, found %d.%d; name one: make PYTHON=python3.12" % v)'
	@echo "Installing into $(VENV), about two minutes ..."
	@$(PYTHON) -m venv $(VENV)
	@$(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt setuptools
	@$(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --no-build-isolation --editable '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) out .mypy_cache .pytest_cache .ruff_cache .hypothesis
