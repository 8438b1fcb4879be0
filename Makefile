# make demo         install, then play a trained policy and plot its learned reward
# make quickstart   install, then videos in, trained policy out, report in runs/quickstart
# make test         install, then check
# make promises     install, then check each promise of docs/what_can_go_wrong.md, the slow tests included
# make lint         ruff
# make docs         the site in site/, warnings as errors
# make lock         resolve requirements.lock again, and list its packages in sbom.cdx.json (needs uv)

SHELL := /bin/bash
# The first Python on the path that the project supports.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null \
	&& echo $$p && break; done)
BIN := .venv/bin

.PHONY: demo quickstart test slow promises lint docs lock

demo: .venv/installed
	$(BIN)/gril demo $(ARGS)

quickstart: .venv/installed
	$(BIN)/gril quickstart $(ARGS)

test: .venv/installed
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadfile

slow: .venv/installed
	$(BIN)/python -m pytest -m slow

promises: .venv/installed
	$(BIN)/python -m pytest -m "slow or not slow" $$(grep -o 'tests/[a-z_/]*\.py' docs/what_can_go_wrong.md | sort -u)

lint: .venv/installed
	$(BIN)/pip install -q "ruff>=0.9"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

docs: .venv/installed
	$(BIN)/pip install -q --disable-pip-version-check --no-build-isolation -e '.[docs]'
	$(BIN)/python docs/stage.py build/docs
	$(BIN)/zensical build --clean --strict

lock:
	uv pip compile -q --universal --python-version 3.11 --extra test --no-annotate --no-header \
		--no-emit-index-url --generate-hashes --upgrade pyproject.toml -o requirements.lock
	sed -e '/--hash/d' -e 's/ \\$$//' requirements.lock | uvx -q --from 'cyclonedx-bom>=7,<8' cyclonedx-py requirements \
		--output-reproducible --of JSON --sv 1.6 --pyproject pyproject.toml -o sbom.cdx.json -

.venv/installed: requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "no Python 3.11 to 3.13 on the path: install one, or make PYTHON=..." >&2; exit 2; }
	@echo "installing into .venv; this takes a minute or more"
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -q --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@
