# `make` alone prints this list. Every target works on a fresh clone: .venv is made when missing.
PYTHON ?= python3
BIN := .venv/bin
OUT := demo-out

.DEFAULT_GOAL := help
.PHONY: help demo test check format docs gallery links bench release release-check translations clean

help: ## print the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## */\t/' | expand -t 10

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# The demo needs no tools of developers: it takes what they have installed, or installs less.
.venv/demo:
	@echo "Once: pip fetches some 300 MB into .venv and unpacks 1.1 GB; 1 to 5 minutes."
	@test -e .venv/installed || $(PYTHON) -m venv .venv
	@test -e .venv/installed || $(BIN)/python -m pip install --disable-pip-version-check --editable .
	@touch $@

demo: .venv/demo ## make a small survey, classify it, grid it, and say how good the result is
	$(BIN)/python -m toolbox demo --folder $(OUT)

test: .venv/installed ## run the tests; with CI=true also the long ones
	$(BIN)/python -m pytest -n 2 --dist worksteal $(if $(CI),--durations=40,-m "not slow")

check: .venv/installed ## lint, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv/installed ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: .venv/installed ## rewrite what is made from the declarations, and build the site (build/site)
	$(BIN)/python -m toolbox.reference
	PYTHONPATH=. $(BIN)/python docs/make_clearance_rules.py
	PYTHONPATH=. $(BIN)/python docs/make_figures.py
	PYTHONPATH=. $(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -d build/doctrees docs build/site

links: .venv/installed ## ask every address that the documentation names; needs the network
	PYTHONPATH=. $(BIN)/sphinx-build --quiet -b linkcheck -d build/doctrees docs build/links

translations: .venv/installed ## bring the catalogues of translations up to date, and say what is missing
	$(BIN)/python -m toolbox.translations

gallery: .venv/installed ## run the examples of all tools and the jobs, and draw their pictures; some minutes
	PYTHONPATH=. $(BIN)/python docs/make_tool_pictures.py
	PYTHONPATH=. $(BIN)/python docs/make_job_pictures.py

bench: .venv/installed ## measure what docs/reference/figures.md says, an hour; needs TOOLBOX_TEST_DATA
	$(BIN)/python -m tests.bench figures
	PYTHONPATH=. $(BIN)/python docs/make_figures.py

release: .venv/installed ## build wheel, SBOM and list of licences into dist
	rm -rf dist build/bare
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/uv build --quiet --wheel --out-dir dist .
	$(BIN)/uv venv --quiet build/bare
	$(BIN)/uv pip install --quiet --python build/bare/bin/python dist/*.whl
	$(BIN)/cyclonedx-py environment --output-reproducible --output-file dist/sbom.cdx.json build/bare
	$(BIN)/pip-licenses --python build/bare/bin/python --format markdown --output-file dist/licences.md

release-check: .venv/installed ## read the conda recipe, and run the demo from the wheel on each Python
	$(BIN)/uv run --quiet --no-project --with py-rattler-build python packaging/conda/check.py
	.ci/release-check

clean: ## remove what the targets made, compiled loops too
	rm -rf .venv $(OUT) build dist
	find algorithms -name '*.nb[ic]' -delete
