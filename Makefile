# trifarm: at most ten targets; each makes the .venv it needs.
PYTHON ?= python3
# many tests wait for farms: twice as many processes as cores
PROCESSES ?= $(shell expr 2 \* $$(nproc))
PIP = .venv/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

unexport PYTHONDONTWRITEBYTECODE  # hundreds of processes start; each would compile the project again

.PHONY: setup demo test test-all check up bench image homes clean

setup: .venv/full        ## install everything, learning and tests included (torch: several GB)

demo: .venv/farm         ## 40 push trials of the reference policy on 4 robots, with report and logs
	.venv/bin/trifarm demo

test: .venv/full         ## every claim once; prints the ten slowest tests
	.venv/bin/python -m pytest -q -n $(PROCESSES) --dist loadfile --no-loadscope-reorder --durations 10 -m "not scale"

test-all: .venv/full     ## all tests, also those that repeat a claim at larger scale
	.venv/bin/python -m pytest -q -n $(PROCESSES) --dist loadfile --no-loadscope-reorder --durations 10

check: .venv/full        ## style, types, import rules
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyrefly check
	.venv/bin/lint-imports

up: .venv/farm           ## a farm of 4 robots until Ctrl-C
	.venv/bin/trifarm up

bench: .venv/farm        ## what steps, trials, robots and training cost, beside what is kept of such a machine
	.venv/bin/python -m tests.benchmarks.bench --out bench-results.json

image:                   ## container images
	docker compose build

homes:                   ## what tests of PostgreSQL and S3 need; without it they are skipped
	tests/install_homes.sh

clean:                   ## remove what the other targets made
	rm -rf .venv demo-farm build *.egg-info bench-results.json

.venv/farm: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(PIP) -e .
	touch $@

.venv/full: .venv/farm
	$(PIP) -e ".[learning,dev]"
	touch $@
