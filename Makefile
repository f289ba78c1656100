# Everything runs in an environment of its own in .venv; only Python >= 3.11, git and make are needed beforehand.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
JOBS ?= 2
NEWEST ?= >=3.12
SYSTEMS ?= /tmp/gtf-tune-systems

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-lowest test-newest test-systems check bench experiments paper soak format lock clean

help: ## Show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk 'BEGIN {FS = ":.*## "} {printf "  make %-12s %s\n", $$1, $$2}'

setup: $(STAMP) ## Create the environment in .venv

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "gtf-tune needs Python >= 3.11; call make PYTHON=/path/to/python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,postgres,dask,heic,png]'
	@touch $@

demo: setup ## Render a room, tune GLOMAP on it without ground truth, show and report the result
	$(BIN)/gtf-tune demo

test: setup ## Run the tests (under five minutes on two cores)
	$(BIN)/python -m pytest -n $(JOBS)

test-lowest: setup ## Run the tests on the lowest allowed versions of the dependencies
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv venv --quiet --clear --python $(PYTHON) $(VENV)-lowest
	$(BIN)/uv pip install --quiet --python $(VENV)-lowest/bin/python --resolution lowest-direct -e '.[postgres,dask]'
	$(VENV)-lowest/bin/python -c 'import pycolmap, optuna; print("pycolmap", pycolmap.__version__, "optuna", optuna.__version__)'
	$(BIN)/uv pip freeze --python $(VENV)-lowest/bin/python --exclude-editable > $(VENV)-lowest/constraints.txt
	$(BIN)/uv pip install --quiet --python $(VENV)-lowest/bin/python -c $(VENV)-lowest/constraints.txt -e '.[dev]'
	$(VENV)-lowest/bin/python -m pytest -n $(JOBS)

test-newest: setup ## Run the tests on the newest Python of this machine, with the newest dependencies
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv venv --quiet --clear --python '$(NEWEST)' $(VENV)-newest
	$(BIN)/uv pip install --quiet --python $(VENV)-newest/bin/python -e '.[dev,postgres,dask,heic,png]'
	$(VENV)-newest/bin/python --version
	$(VENV)-newest/bin/python -m pytest -n $(JOBS)

test-systems: setup ## Install the real systems of examples/systems into environments of their own, and run them
	@for system in examples/systems/*/; do \
	  name=$$(basename $$system); \
	  test -x $(SYSTEMS)/$$name/bin/python || $(PYTHON) -m venv $(SYSTEMS)/$$name || exit 1; \
	  $(SYSTEMS)/$$name/bin/python -m pip install --quiet --disable-pip-version-check -r $$system/requirements.txt || exit 1; \
	  grep -q "\"$$name\"" tests/systems/test_*.py || { echo "no test runs $$name"; exit 1; }; \
	done
	GTF_TUNE_SYSTEMS=$(abspath $(SYSTEMS)) $(BIN)/python -m pytest -n 0 -v -rs tests/systems > $(SYSTEMS)/test.log 2>&1; \
	  status=$$?; cat $(SYSTEMS)/test.log; exit $$status
	@! grep -q SKIPPED $(SYSTEMS)/test.log || { echo 'a system was skipped'; exit 1; }

check: setup ## Lint, type-check, check layers, file sizes, links and spelling, build the documentation
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	PYTHONPATH=. $(BIN)/lint-imports
	$(BIN)/python tests/checks/file_sizes.py
	$(BIN)/python tests/checks/import_circles.py
	$(BIN)/python tests/checks/links.py
	$(BIN)/codespell README.md CHANGELOG.md CONTRIBUTING.md docs gtf_tune examples studies storage dashboards experiments benchmarks
	$(BIN)/python docs/generate.py --check
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: setup ## Measure side by side and rewrite docs/performance.md
	$(BIN)/python -m benchmarks

experiments: setup ## Run the paper's experiments (hours; resumable) and rewrite docs/results-appendix.md
	$(BIN)/python -m experiments

paper: setup ## Make the paper's figures beside ours and docs/paper.md (resumable; DATA=DIR: its own data sets)
	$(BIN)/python -m experiments.paper $(if $(DATA),--data $(DATA))

soak: setup ## Inject faults for a long time
	$(BIN)/python -m pytest -m soak tests/faults

format: setup ## Format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: setup ## Resolve the dependencies anew into constraints.txt
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --extra dev --extra postgres --extra dask --extra heic --extra png --universal --python-version 3.11 --no-header --no-annotate --output-file constraints.txt

clean: ## Remove the environment and what the tools left
	rm -rf $(VENV) $(VENV)-lowest $(VENV)-newest build dist site .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
