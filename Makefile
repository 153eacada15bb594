# Two commands: `make tulip` identifies the TULip leg, `make test` tests the code. Both make .venv.
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
RUN := $(VENV)/bin/python
# Matrices here are small: a second BLAS thread only waits, and takes the core of another process.
export OPENBLAS_NUM_THREADS ?= 1
# Without cached bytecode every process of the tests would compile the package again, 100 s of processor time in all.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: tulip biped test test-slow test-all test-rounding test-hebi test-simulators test-browser look pictures claims bench lint docs wheel env dev clean

tulip: env
	$(RUN) scripts/identify_tulip_leg.py

# Two TULip legs with a trunk in MuJoCo: hanging, then standing; out/biped/report.html.
biped: dev
	$(RUN) scripts/identify_biped.py --output out/biped

# The tests of pages would only load their browser.
PYTEST := $(RUN) -m pytest -n 2 --dist worksteal --ignore tests/browser

# In minutes, for every change; the slow tests, each with its reason, are for `make test-slow`.
test: lint
	$(PYTEST) -m 'not slow'

test-slow: dev
	$(PYTEST) -m slow

test-all: test test-slow

# What rests on rounding (decisions of rank, factors, programs near singularity) and the figures of a page, on other
# processors: OpenBLAS has a kernel for each kind. Only a processor with AVX-512 has that of SkylakeX, which all other
# tests use there.
PAGE := tests/repository/test_documents.py::test_code_of_a_page_runs_and_prints_what_the_page_says[docs/first_result.md]
ROUNDING := $(shell grep -rl --include='*.py' 'pytest.mark.rounding' tests)
KERNELS ?= Prescott Haswell
test-rounding: dev
	@for kernel in $(KERNELS); do \
	  echo "Kernels of OpenBLAS: $$kernel"; \
	  OPENBLAS_CORETYPE=$$kernel $(RUN) -m pytest -n 2 --dist worksteal -m 'page or rounding and not slow' '$(PAGE)' $(ROUNDING); \
	done

# HEBI's reader has no wheel: it is built from its sources, so it is no part of `make test`, which skips these tests.
test-hebi: dev
	$(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[hebi]'
	$(RUN) -m pytest -m hebi $(shell grep -rl --include='*.py' 'pytest.mark.hebi' tests)

# Exported files, read by the packages of their simulators.
test-simulators: dev
	$(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --only-binary=:all: --editable '.[simulators]'
	$(RUN) -m pytest tests/export/test_simulators.py

# What is read in a browser, in headless Chromium; installed where it is not there.
BROWSERS := chromium chromium-browser google-chrome google-chrome-stable
test-browser: dev
	$(chromium)
	$(RUN) -m pytest -m browser tests/browser

# Screenshots of reports, documents and the view into out/look/, to be looked at.
look: docs
	$(chromium)
	$(RUN) -m scripts.look

# The pictures of README and documents, made again; two of benchmarks of hours have their own scripts.
pictures: dev
	$(chromium)
	$(RUN) scripts/gallery.py

# The figures of README and documents, measured again: hours. The runs of less than 20 s: make claims CLAIMS=--quick
CLAIMS ?=
claims: dev
	$(RUN) -m scripts.claims $(CLAIMS)

# Whether the code is as fast as at the last tag, measured side by side; BENCH='--only identify' for one row.
BENCH ?=
bench: dev
	$(RUN) -m scripts.benchmarks.speed_held $(BENCH)

define chromium
	@for name in $(BROWSERS); do command -v $$name >/dev/null && exit 0; done; \
	if [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then \
	  echo "make $@ needs Chromium: install it (Debian: sudo apt-get install chromium), then repeat" >&2; exit 1; \
	fi; \
	echo "Installing Chromium ..."; \
	apt-get update -qq && apt-get install -qq --yes --no-install-recommends chromium >/dev/null
endef

# Two workers take half the time, 27 s without a cache; on a busy machine they may not start within 3 s (exit code 2).
lint: dev
	$(RUN) -m deptry seaid
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy --num-workers 2 || { [ $$? = 2 ] && $(RUN) -m mypy; }

docs: dev
	$(RUN) -m sphinx --quiet --fail-on-warning --keep-going --nitpicky docs out/docs
	@echo "The documents: out/docs/index.html"

# What is published, built as anyone builds it, installed alone into an empty environment and used there.
WHEEL := out/wheel
wheel: dev
	rm -rf $(WHEEL)
	PIP_ONLY_BINARY=:all: PIP_CONSTRAINT=$(CURDIR)/constraints.txt $(RUN) -m build --outdir $(WHEEL) .
	$(RUN) -m venv $(WHEEL)/venv
	$(WHEEL)/venv/bin/python $(PIP) --quiet $(WHEEL)/*.whl
	cp models/tulip_leg.urdf models/tulip_leg.toml $(WHEEL)
	cd $(WHEEL) && venv/bin/python -c 'import seaid; print(seaid.__version__, seaid.__file__)'
	cd $(WHEEL) && venv/bin/seaid inspect tulip_leg.urdf --drives tulip_leg.toml

env: $(INSTALLED)

dev: $(INSTALLED_DEV)

# pip says nothing but which wheels it takes; what it wrote is kept, and shown where it fails.
PIP := -m pip install --disable-pip-version-check --only-binary=:all: --constraint constraints.txt
define install
	@$(RUN) $(PIP) $(1) 2>&1 | tee $(VENV)/install.log \
	  | sed -un -E 's/^ *(Downloading|Using cached) ([A-Za-z0-9_.]+)-[^ ]*\.whl \((.*)\)/  \2  \3/p; s/^Installing collected.*/  unpacking .../p' \
	  || { grep -v '^WARNING' $(VENV)/install.log | tail -n 20 >&2; exit 1; }
endef

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and "seaid needs Python 3.11 or newer, found %d.%d; name one: make PYTHON=python3.12" % v)'
	@echo "Installing seaid and what it needs into $(VENV) (1 GB on disk, about a minute):"
	@$(PYTHON) -m venv $(VENV)
	$(call install,setuptools)
	$(call install,--no-build-isolation --editable .)
	@touch $@

$(INSTALLED_DEV): $(INSTALLED)
	@echo "Installing what tests, documents and examples need as well (another 1.5 GB, about a minute):"
	$(call install,--no-build-isolation --editable '.[dev]')
	@touch $@

clean:
	rm -rf $(VENV) out .mypy_cache .pytest_cache .ruff_cache .hypothesis
