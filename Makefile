# Needs Python >= 3.10 and Rust, nothing else; PYTHON=python3.12 names the interpreter of a new
# .venv.
.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup packages demo test test-long fuzz audit lint docs bench bench-latency bench-peers \
	instructions picture wheel test-wheel workflows release-check study-defaults \
	study-certificates study-tuning study-promise study-sensitivity study-reproduction \
	study-intervals study-estimators study-disturbance study-stated-noise study-evidence \
	study-faults study-fusion study-inputs study-lifted study-pages study-reach study-plot-libraries \
	example-pages clean

PY := .venv/bin/python
# The build belongs to .venv, whatever environment the shell is in.
export VIRTUAL_ENV := $(CURDIR)/.venv
unexport CONDA_PREFIX PYTHONHOME PYTHONPATH
# Two tests at a time, each with one BLAS thread: BLAS's threads wait for each other by spinning,
# which takes minutes where there are more of them than cores.
PYTEST := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 --dist worksteal

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-18s  %s\n", $$1, $$2 }' \
		$(firstword $(MAKEFILE_LIST))

setup: ## .venv and the compiled core, brought up to date (the others do what they need of it)
	@tools/setup.sh

packages:
	@tools/setup.sh packages

demo: ## the paper's satellite: an estimate and its figure in ddmhe-demo/
	@tools/setup.sh run
	$(PY) -m ddmhe demo --out ddmhe-demo

# One profile for the tests, the benches and Python's core, and --workspace, which gives all three
# the features of the whole workspace: the dependencies are compiled once.
test: setup ## all tests: Rust, then Python
	cargo test --workspace --release --locked
	$(PYTEST)

# Many more cases of what the tests hold: minutes, where `make test` takes a sample.
test-long: setup ## the long tests, which `make test` leaves out
	cargo test --workspace --release --locked -- --ignored long --test-threads=1
	$(PYTEST) -m long
	tests/fuzz/run.sh 60

fuzz: setup ## half an hour of a fuzzer for each of what reads bytes or numbers
	tests/fuzz/run.sh 1800

# Needs `cargo install cargo-deny --locked`; advisories come from the network. Licences, bans and
# sources are in deny.toml.
audit: ## licences and known faults of what it is built from
	cargo deny --locked check
	test -d .venv-audit || python3 -m venv .venv-audit
	.venv-audit/bin/pip install --quiet --disable-pip-version-check pip-audit==2.10.1
	.venv-audit/bin/pip-audit --strict --no-deps --disable-pip \
		-r requirements-dev.txt

lint: rust-components packages ## formatting, clippy, rustdoc, ruff, mypy
	cargo fmt --all --check
	cargo fmt --manifest-path tests/no_std/Cargo.toml --check
	cargo clippy --workspace --all-targets --locked -- -D warnings
	for features in "" clarabel rayon serde clarabel,rayon clarabel,serde rayon,serde; do \
		cargo clippy -p ddmhe-core --no-default-features --features "$$features" --quiet \
			--locked -- -D warnings || exit 1; done
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --workspace --exclude ddmhe-py --locked
	$(PY) -m ruff check
	$(PY) -m ruff format --check
	$(PY) -m mypy

.PHONY: rust-components
rust-components:
	@for c in fmt clippy; do cargo $$c --version >/dev/null 2>&1 || { \
		echo "ddmhe: 'cargo $$c' is needed, not found (rustup component add rustfmt clippy)" >&2; \
		exit 1; }; done

# Without a network once the packages are there.
docs: setup ## the site, in docs/_build: guides, gallery, reference, measurements
	$(PY) -m pip install --quiet --disable-pip-version-check -r requirements-docs.txt
	OPENBLAS_NUM_THREADS=1 $(PY) -m sphinx -W --keep-going -q docs docs/_build
	@echo "docs/_build/index.html"

bench: setup ## time of the core's operations, in one table
	cargo bench --workspace --locked
	$(PY) benches/table.py

instructions: ## instructions of a step (callgrind) against benches/instructions.json
	cargo build --release --locked --workspace --example instructions
	python3 benches/instructions.py

bench-latency: ## ten million steps: percentiles, the longest, allocations
	cargo bench --locked -p ddmhe-core --bench latency

# An environment of its own: the solvers are many and large.
bench-peers: wheel ## the same windows through every solver a user could pick; docs/benchmarks.md
	cargo build --release --locked --workspace --example timed_steps
	test -d .venv-peers || $(PY) -m venv .venv-peers
	.venv-peers/bin/pip install --quiet --disable-pip-version-check -r benches/peers/requirements.txt
	.venv-peers/bin/pip install --quiet --disable-pip-version-check --force-reinstall dist/*.whl
	.venv-peers/bin/python benches/peers --docs docs/benchmarks.md

wheel: setup ## a wheel in dist/
	rm -rf dist
	$(PY) -m maturin build --release --locked --out dist

test-wheel: wheel ## the wheel in an empty environment outside of the sources
	$(PY) tools/try_wheel.py dist/*.whl

.venv-release/installed: requirements-release.txt
	test -d .venv-release || python3 -m venv .venv-release
	.venv-release/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

# Without a network once .venv-release is there.
workflows: .venv-release/installed ## what runs on GitHub, the issue forms, CITATION.cff
	.venv-release/bin/actionlint .github/workflows/*.yml
	.venv-release/bin/zizmor --offline --quiet --min-severity medium .github
	.venv-release/bin/check-jsonschema --builtin-schema vendor.github-workflows \
		.github/workflows/*.yml
	.venv-release/bin/check-jsonschema --builtin-schema vendor.dependabot .github/dependabot.yml
	.venv-release/bin/check-jsonschema --builtin-schema vendor.github-issue-forms \
		.github/ISSUE_TEMPLATE/bug.yml .github/ISSUE_TEMPLATE/idea.yml
	.venv-release/bin/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff

release-check: setup workflows ## all of a release but the upload: crates, sdist, wheels, licences
	tools/release_check.sh

study-defaults: setup ## the study behind the default settings
	$(PY) studies/defaults.py

study-certificates: setup ## what certificates hold and cost
	$(PY) studies/certificates.py

study-tuning: setup ## tuned settings against the best in hindsight
	$(PY) studies/tuning.py

study-promise: setup ## whether later errors stay in the range that tune promises
	$(PY) studies/promise.py

study-stated-noise: setup ## what tune makes of outputs noisier than recorded
	$(PY) studies/stated_noise.py

study-sensitivity: setup ## errors over mu, rho, M, rank and noise on the 3-DOF case
	$(PY) studies/sensitivity.py

study-intervals: setup ## interval observer: 100 000 trajectories, widths, time
	$(PY) studies/intervals.py

# In the environment of bench-peers, if it is there, do-mpc takes part.
study-estimators: setup ## Dd-MHE beside estimators that identify a model; docs/estimators.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
		$(firstword $(wildcard .venv-peers/bin/python) $(PY)) studies/which_estimator.py

study-disturbance: setup ## fitted disturbance and weights from the recording
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/disturbance.py

study-inputs: setup ## what known inputs are worth, and with which weights
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/known_inputs.py

# DDMHE_DATA=FOLDER: measured logs, which take part where they are.
study-evidence: setup ## how often errors lie within the stated bars; docs/measured/evidence.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/evidence.py

study-faults: setup ## which faults of outputs are seen, when; docs/measured/evidence.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/faults.py

study-lifted: setup ## the polynomial model beside the affine one; docs/lifted.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/lifted.py

study-fusion: setup ## what a camera's minute is worth beside the torque; docs/measured/reach.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/fusion.py

# DDMHE_DATA=FOLDER: measured pendulums, which take part where they are.
study-reach: setup ## how far estimates of a tumbling body reach; docs/measured/reach.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/reach.py
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/reach_variations.py
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/reach_limits.py
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/reach_recordings.py
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/reach_field.py

picture: setup ## the README's picture and the errors below it
	OPENBLAS_NUM_THREADS=1 $(PY) studies/first_picture.py

study-campaign: setup ## dispersed satellites with every estimator; docs/measured/campaign.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/campaign.py

study-campaign-tuning: setup ## settings for all dispersed satellites at once; docs/measured/campaign.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/campaign_tuning.py

study-campaign-scale: setup ## what a campaign costs beside a bare loop; docs/measured/campaign.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/campaign_scale.py

study-pages: setup ## sizes and times of pages on long runs; docs/report.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) studies/pages.py

# In an environment of its own: the libraries are many and large.
study-plot-libraries: ## libraries that could draw pages, in Chromium; docs/report.md
	test -d .venv-pages || python3 -m venv .venv-pages
	.venv-pages/bin/pip install --quiet --disable-pip-version-check numpy pandas bokeh==3.9.2 \
		plotly==7.1.0 altair==6.3.0 vl-convert-python==1.9.0.post1 playwright==1.65.2
	.venv-pages/bin/python studies/plot_libraries.py

example-pages: setup ## the pages of docs/reports
	$(PY) studies/example_pages.py

study-reproduction: setup ## every experiment of both papers; docs/claims.md and its tables
	$(PY) -m ddmhe reproduce all --out ddmhe-reproduce
	cp ddmhe-reproduce/claims.md docs/claims.md
	cp ddmhe-reproduce/tables.md docs/reproduce-tables.md

clean: ## removes everything that was made
	rm -rf .venv .venv-audit .venv-peers .venv-pages .venv-release target dist python/ddmhe/_core*.so
	rm -rf ddmhe-demo ddmhe-design ddmhe-tune ddmhe-reproduce ddmhe-interval ddmhe-campaign
	rm -rf .mypy_cache .pytest_cache .ruff_cache
	find python tests -name __pycache__ -prune -exec rm -rf {} +
