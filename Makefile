# What a user gives is text: make itself expands no part of it either, from the command line or the environment.
GIVEN := STUDY JOBS STAGE A B ALSO CSV YIELD UNIT SERIES OVER UNITS NOISE DATA DIMENSIONS RUN COUNT SEED CASES FIRST MESH DESIGN OUT THIRD
define AS_TEXT
override $(1) := $$(value $(1))
export $(1)
endef
$(foreach name,$(GIVEN),$(if $(filter-out undefined,$(origin $(name))),$(eval $(call AS_TEXT,$(name)))))

# What a user calls. Every target makes the virtual environment first if it is missing or out of date.
# The newest Python of those that the packages are pinned for; PYTHON=python3.12 takes another.
SUITS := import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info < (3, 15))
PYTHON ?= $(shell for name in python3.14 python3.13 python3.12 python3.11 python3 python; do \
	if $$name -c '$(SUITS)' 2>/dev/null; then echo $$name; break; fi; done)
NO_PYTHON := found no Python 3.11 to 3.14 with its module venv (on Debian: apt-get install python3 python3-venv); \
	if it has another name, say make PYTHON=<name>
STUDY ?= paper
export STUDY
# What a user gives reaches the shell as a variable in quotes, "$$STUDY": no character of it is a command.
VENV := .venv
STAGES := $(shell sed -n 's/^UPSTREAM = (\(.*\))/\1, report/p' stages/chain.py | tr 'A-Z' 'a-z' | tr -d ',')
PLAIN_STAGES := $(filter-out tails,$(STAGES))
PIPELINE := $(VENV)/bin/python -m pipeline
VALIDATION := $(VENV)/bin/python -m tests.validation
JOBS_OPTION := $(if $(JOBS),--jobs "$$JOBS")

.DEFAULT_GOAL := help
.PHONY: help setup study $(STAGES) why test attack mutants long lint types docs identify rig changed population blind lots assemble certificate workbook \
	bench paper calibrate verify coverage tails flank compare allocate bounds joints provenance check licences clean-runs

help:  ## list the targets
	@sed -n 's/^\([a-z$$][^:=]*\):[^=]*## \(.*\)/\1|\2/p' Makefile | sed 's/$$(PLAIN_STAGES)/$(PLAIN_STAGES)/' \
		| while IFS='|' read -r name text; do printf '  make %-10s %s\n' "$$name" "$$text"; done

$(VENV)/installed: pyproject.toml constraints.txt
	$(or $(PYTHON),$(error $(NO_PYTHON))) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --requirement constraints.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

setup: $(VENV)/installed  ## make the virtual environment with the pinned packages

study: $(VENV)/installed  ## run all stages of a study: make study STUDY=quick JOBS=2
	$(PIPELINE) run report --study "$$STUDY" $(JOBS_OPTION)

$(PLAIN_STAGES): $(VENV)/installed  ## run one stage of STUDY and what it needs that is missing or stale
	$(PIPELINE) run $@ --study "$$STUDY" $(JOBS_OPTION)

check: $(VENV)/installed  ## compare every byte of a run with its records: make check STUDY=quick
	$(PIPELINE) check "$$STUDY"

why: $(VENV)/installed  ## say why a stage would run: make why STAGE=hysteresis STUDY=quick
	@$(PIPELINE) why $(if $(STAGE),"$$STAGE",report) --study "$$STUDY"

compare: $(VENV)/installed  ## compare two studies: make compare A=paper B=quick
	$(PIPELINE) compare $(if $(A),"$$A",$(error say which: make compare A=<study> B=<study>)) \
		$(if $(B),"$$B",$(error say which: make compare A=<study> B=<study>)) $(JOBS_OPTION)

allocate: $(VENV)/installed  ## find the cheapest tolerances of STUDY that keep its limits: make allocate YIELD=0.99
	$(PIPELINE) allocate --study "$$STUDY" $(if $(YIELD),--yield "$$YIELD") $(JOBS_OPTION)

bounds: $(VENV)/installed  ## worst cases of STUDY over its tolerances, beside linear stacks and capability
	$(PIPELINE) bounds --study "$$STUDY" $(JOBS_OPTION)

lots: $(VENV)/installed  ## yield of STUDY made from measured parts: make lots CSV=parts.csv [ALSO=other_lot.csv] STUDY=quick
	$(PIPELINE) lots --csv $(if $(CSV),"$$CSV",$(error say which parts: make lots CSV=<file>)) $(if $(ALSO),--csv "$$ALSO") \
		--study "$$STUDY" $(JOBS_OPTION)

assemble: $(VENV)/installed  ## which measured parts to put together: make assemble A=rings.csv B=disks.csv STUDY=quick
	$(PIPELINE) assemble --csv $(if $(A),"$$A",$(error say which parts: make assemble A=<file> B=<file>)) \
		--csv $(if $(B),"$$B",$(error say which parts: make assemble A=<file> B=<file>)) --study "$$STUDY" $(JOBS_OPTION)

certificate: $(VENV)/installed  ## what one unit will do: make certificate DIMENSIONS=unit17.toml [UNIT=measured] STUDY=quick
	$(PIPELINE) certificate --dimensions $(if $(DIMENSIONS),"$$DIMENSIONS",$(error say which: make certificate DIMENSIONS=<file>)) \
		$(if $(UNIT),--unit "$$UNIT") --study "$$STUDY" $(JOBS_OPTION)

workbook: $(VENV)/installed  ## tables of a page or a run as one .xlsx file: make workbook RUN=quick
	$(PIPELINE) workbook $(if $(RUN),"$$RUN",$(error say which: make workbook RUN=<folder in data/runs>))

joints: $(VENV)/installed  ## write backlash, stiffness and friction of STUDY as joints for MuJoCo, URDF and SDFormat
	$(PIPELINE) joints --study "$$STUDY" $(JOBS_OPTION)

provenance: $(VENV)/installed  ## write inputs, versions and hashes of the run of STUDY as an RO-Crate
	$(PIPELINE) provenance "$$STUDY"

identify: $(VENV)/installed  ## say why a measured unit differs from its model (UNIT=folder), or what states share (SERIES=folder)
	$(PIPELINE) identify $(if $(SERIES),--series "$$SERIES" $(if $(OVER),--over "$$OVER"),--unit \
		$(if $(UNIT),"$$UNIT",$(error say which: make identify UNIT=<folder>, or SERIES=<folder of states>))) $(JOBS_OPTION)

rig: $(VENV)/installed  ## identify all states of the printed drive's rig, beside the baselines: make rig DATA=<folder>
	$(VALIDATION) rig --data $(if $(DATA),"$$DATA",$(error say where its data are: make rig DATA=<folder>))

changed: $(VENV)/installed  ## say what changed between two measurements of one drive: make changed A=before B=after
	$(PIPELINE) changed --before $(if $(A),"$$A",$(error say which units: make changed A=<folder> B=<folder>)) \
		--after $(if $(B),"$$B",$(error say which units: make changed A=<folder> B=<folder>)) $(if $(ALSO),--also $$ALSO)

population: $(VENV)/installed  ## compare measured units with a study: make population UNITS=units.csv STUDY=paper [NOISE=1]
	$(PIPELINE) population --units $(if $(UNITS),"$$UNITS",$(error say which units: make population UNITS=<file>)) --study "$$STUDY" \
		$(if $(NOISE),--noise "$$NOISE") $(JOBS_OPTION)

blind: $(VENV)/installed  ## test the identification on units whose truth it cannot read: make blind CASES=60 FIRST=0
	$(VALIDATION) blind $(if $(CASES),--cases "$$CASES") $(if $(THIRD),--third "$$THIRD") $(if $(FIRST),--first "$$FIRST") $(JOBS_OPTION)

test: $(VENV)/installed  ## run the tests but for the long ones
	$(VENV)/bin/python -m pytest

long: $(VENV)/installed  ## run the tests that take more than a second each: whole identifications, whole turns, kills
	$(VENV)/bin/python -m pytest -m "long and not attack"

attack: $(VENV)/installed  ## run what make test runs in part at full size: 10,000 fuzzed inputs, 50 kills, 500 random designs
	$(VENV)/bin/python -m pytest -n 0 -s -m attack -o faulthandler_timeout=7200

mutants: $(VENV)/installed  ## change one operator, constant or bound at a time and see which no test notices: make mutants COUNT=200
	$(VENV)/bin/python tests/attack/mutants.py $(if $(COUNT),--count "$$COUNT") $(if $(SEED),--seed "$$SEED")

lint: $(VENV)/installed  ## check style and the direction of imports
	$(VENV)/bin/ruff check .
	$(VENV)/bin/lint-imports --no-cache

types: $(VENV)/installed  ## check types
	$(VENV)/bin/mypy

$(VENV)/documented: $(VENV)/installed docs/requirements.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --requirement docs/requirements.txt
	@touch $@

docs: $(VENV)/documented  ## build the pages of docs/ with the reference: build/docs/index.html
	$(VENV)/bin/sphinx-build -q -W --keep-going docs build/docs

bench: $(VENV)/installed  ## measure speed, as ratios within one run
	$(VALIDATION) bench --study "$$STUDY"

paper: $(VENV)/installed  ## compare the paper's Table 2, contacts and figures with the model: one HTML page
	$(PIPELINE) paper $(JOBS_OPTION)

calibrate: $(VENV)/installed  ## fit numbers of the design to Table 2, with intervals and what is not determined
	$(PIPELINE) calibrate

verify: $(VENV)/installed  ## compare the mechanics with exact answers and independent solvers: make verify MESH=coarse, or STUDY=rv_80e
	$(PIPELINE) verify $(if $(filter override,$(origin STUDY)),--study "$$STUDY",--mesh $(if $(MESH),"$$MESH",paper))

flank: $(VENV)/installed  ## write a design's flank as CSV and DXF: make flank DESIGN=pham2017 OUT=flank
	$(PIPELINE) flank --design $(if $(DESIGN),"$$DESIGN",$(error say which design: make flank DESIGN=<file> OUT=<folder>)) \
		--out $(if $(OUT),"$$OUT",$(error say where to: make flank DESIGN=<file> OUT=<folder>))

tails: $(VENV)/installed  ## run the stage tails, for any STUDY: units beyond limits in parts per million, far quantiles
	$(PIPELINE) tails --study "$$STUDY" $(JOBS_OPTION)

coverage: $(VENV)/installed  ## count how often intervals hold the truth, over 2,000 experiments on the rigid play
	$(VALIDATION) coverage --study "$$STUDY" $(JOBS_OPTION)

licences: $(VENV)/installed  ## list the licence of every package that is installed; fails where one is unknown
	@$(VALIDATION) licences

clean-runs: $(VENV)/installed  ## delete all runs, never inputs
	$(PIPELINE) clean-runs
