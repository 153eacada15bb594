# Two commands: `make tulip` identifies the TULip leg, `make test` proves the code. Both make .venv.
PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
RUN := $(VENV)/bin/python
# Matrices here are small: a second BLAS thread only waits, and takes the core of another process.
export OPENBLAS_NUM_THREADS := 1

.PHONY: tulip test test-browser lint docs wheel env clean

tulip: env
	$(RUN) scripts/identify_tulip_leg.py

test: lint
	$(RUN) -m pytest -n 2 --dist worksteal

# What is read in a browser, in headless Chromium; installed where it is not there.
BROWSERS := chromium chromium-browser google-chrome google-chrome-stable
test-browser: env
	@for name in $(BROWSERS); do command -v $$name >/dev/null && exit 0; done; \
	if [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then \
	  echo "make test-browser needs Chromium: install it (Debian: sudo apt-get install chromium), then repeat" >&2; exit 1; \
	fi; \
	echo "Installing Chromium ..."; \
	apt-get update -qq && apt-get install -qq --yes --no-install-recommends chromium >/dev/null
	$(RUN) -m pytest -m browser tests/browser

lint: env
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

docs: env
	$(RUN) -m sphinx --quiet --fail-on-warning --keep-going --nitpicky docs out/docs
	@echo "The documents: out/docs/index.html"

# What is published, built as anyone builds it, installed alone into an empty environment and used there.
WHEEL := out/wheel
wheel: env
	rm -rf $(WHEEL)
	PIP_CONSTRAINT=$(CURDIR)/constraints.txt $(RUN) -m build --outdir $(WHEEL) .
	$(RUN) -m venv $(WHEEL)/venv
	$(WHEEL)/venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt $(WHEEL)/*.whl
	cp models/tulip_leg.urdf models/tulip_leg.toml $(WHEEL)
	cd $(WHEEL) && venv/bin/python -c 'import seaid; print(seaid.__version__, seaid.__file__)'
	cd $(WHEEL) && venv/bin/seaid inspect tulip_leg.urdf --drives tulip_leg.toml

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
