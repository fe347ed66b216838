# `make` alone prints this list. Every target works on a fresh clone: .venv is made when missing.
PYTHON ?= python3
BIN := .venv/bin
OUT := demo-out

.DEFAULT_GOAL := help
.PHONY: help demo test check format docs gallery links bench clean

help: ## print the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## */\t/' | expand -t 10

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: .venv/installed ## make a small survey, classify it, grid it, and say how good the result is
	@mkdir -p $(OUT)
	$(BIN)/python -m toolbox run samples.scene --kind town --points $(OUT)/town.laz --terrain $(OUT)/truth.tif --overwrite
	$(BIN)/python -m toolbox run ground.classify --points $(OUT)/town.laz --classified $(OUT)/ground.laz --overwrite
	$(BIN)/python -m toolbox run compare.classes --points $(OUT)/ground.laz --reference $(OUT)/town.laz --positive 2 --overwrite --errors $(OUT)/errors.laz --picture $(OUT)/errors.png
	$(BIN)/python -m toolbox run surface.grid --points $(OUT)/ground.laz --classes 2 --cell 0.5 --surface $(OUT)/terrain.tif --picture $(OUT)/terrain.png --overwrite
	@echo "Look at $(OUT)/terrain.png and $(OUT)/errors.png"

test: .venv/installed ## run the tests; with CI=true also the long ones
	$(BIN)/python -m pytest -n 2 $(if $(CI),,-m "not slow")

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
	PYTHONPATH=. $(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -d build/doctrees docs build/site

links: .venv/installed ## ask every address that the documentation names; needs the network
	PYTHONPATH=. $(BIN)/sphinx-build --quiet -b linkcheck -d build/doctrees docs build/links

gallery: .venv/installed ## run the examples of all tools and draw the gallery; some minutes
	PYTHONPATH=. $(BIN)/python docs/make_tool_pictures.py

bench: .venv/installed ## measure speed and memory; needs TOOLBOX_TEST_DATA
	$(BIN)/python -m tests.bench

clean: ## remove what the targets made, compiled loops too
	rm -rf .venv $(OUT) build
	find algorithms -name '*.nb[ic]' -delete
