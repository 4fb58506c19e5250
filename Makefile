# make paper: set up everything and run the main job.   make test: set up everything and test.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
OUT    ?= paper-results
OLDEST := build/oldest
# Rooms whose tests are quick; their coverage is printed. Two files take as long as all others,
# and twice that while they are traced: without them 87 % are covered.
COVERED := plant law region response
TRACED := $(filter-out tests/plant/test_matlab_workspaces.py tests/region/test_z_plane.py, \
    $(wildcard $(COVERED:%=tests/%/test_*.py)))
PARALLEL := -n auto --dist loadfile --no-loadscope-reorder

# Many processes import the same: what they compile of it is kept. pip compiles nothing: most of
# what it installs is never imported.
unexport PYTHONDONTWRITEBYTECODE

# A process of tests for each processor: more threads of BLAS would only hinder one another.
export OPENBLAS_NUM_THREADS := 1

KERNEL := CMakeLists.txt $(wildcard src/kernel/*)
# The kernel with AddressSanitizer and UndefinedBehaviorSanitizer, and what a plain Python preloads.
SANITIZED := build/sanitized
PRELOAD = $(foreach library,asan ubsan stdc++,$(shell $(CXX) -print-file-name=lib$(library).so))

.PHONY: paper test tests checks coverage quick kernel oldest sanitize benchmark checker lint docs clean

# Another BLAS kernel than this processor's own: it rounds differently.
OTHER_KERNEL ?= $(if $(shell grep -m1 -o avx512f /proc/cpuinfo 2>/dev/null),Haswell,Nehalem)
SEARCHES := tests/lmi tests/proof/test_sampling.py tests/certify/test_design.py tests/search/test_limits.py \
    tests/theory/test_thresholds.py tests/theory/test_largest_regions.py

paper: $(VENV)/.installed
	$(BIN)/polefence paper -o $(OUT)

# Most tests, and all else beside them: much of that keeps one processor busy only.
test: $(VENV)/.installed-test
	$(MAKE) --jobs=2 tests checks

tests: $(VENV)/.installed-test
	$(BIN)/pytest $(PARALLEL) $(addprefix --ignore=,$(TRACED))

checks: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) coverage sanitize
	$(BIN)/sphinx-build -W -q -b html docs docs/_build/html
	@! grep -rlE '<(script|link)[^>]+(src|href)="https?:' docs/_build/html --include='*.html'

# How much of some rooms their own tests run. Of all tests it would double their time.
coverage: $(VENV)/.installed-test
	$(BIN)/coverage run -m pytest -p no:cacheprovider $(TRACED)
	$(BIN)/coverage report

# What takes under a minute.
quick: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest $(PARALLEL) -m "not slow"

# The tests of searches once more: no answer may depend on the last bits of floats.
kernel: $(VENV)/.installed-test
	OPENBLAS_CORETYPE=$(OTHER_KERNEL) $(BIN)/pytest $(PARALLEL) $(SEARCHES)

# A selection of tests with the oldest dependencies that pyproject.toml allows, and without the kernel.
oldest: $(VENV)/.created
	$(PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python tests/support/oldest.py > $(OLDEST)/constraints.txt
	POLEFENCE_PURE=1 $(OLDEST)/bin/python -m pip install --quiet --no-compile . pytest pytest-xdist \
	    hypothesis control --constraint $(OLDEST)/constraints.txt
	$(OLDEST)/bin/python -m pytest $(PARALLEL) -p no:cacheprovider -o filterwarnings= tests/law \
	    tests/plant tests/response tests/certify/test_design.py tests/show/test_plots.py

sanitize: $(VENV)/.installed-test
	$(BIN)/python -m pip wheel --quiet --no-build-isolation --no-deps --wheel-dir $(SANITIZED) \
	    --config-settings=cmake.define.POLEFENCE_SANITIZE=ON \
	    --config-settings=build-dir=build/sanitize .
	$(BIN)/python -m zipfile -e $(SANITIZED)/polefence-*.whl $(SANITIZED)
	POLEFENCE_TEST_KERNEL="$$(ls $(SANITIZED)/polefence/_kernel*.so)" LD_PRELOAD="$(PRELOAD)" \
	    ASAN_OPTIONS=detect_leaks=0 $(BIN)/pytest -p no:cacheprovider tests/lmi/test_kernel.py tests/lmi/test_spelt_out.py \
	    tests/lmi/test_interior.py tests/search/tune/test_quadratic.py \
	    tests/search/tune/test_laws_by_kernel.py tests/proof/test_exact.py tests/proof/test_bound.py \
	    tests/response/test_peaks_by_kernel.py tests/vehicle/test_compiled.py

benchmark: $(VENV)/.installed-test
	$(BIN)/python -m pip install --quiet --editable '.[benchmark]'
	$(BIN)/python benchmarks/smallest.py

# The checker alone, as one file that a bare Python runs.
checker: $(VENV)/.installed
	$(BIN)/polefence check --standalone polefence-check.pyz

lint: $(VENV)/.installed-test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/mypy

docs: $(VENV)/.installed-test
	$(BIN)/sphinx-build -W -b html docs docs/_build/html

$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo 'Python 3.11 or later is needed; name one: make PYTHON=python3.12 ...'; exit 1; }
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.installed: $(VENV)/.created pyproject.toml $(KERNEL)
	$(BIN)/python -m pip install --quiet --no-compile --editable .
	touch $@

# Not after .installed: the kernel would be built twice.
$(VENV)/.installed-test: $(VENV)/.created pyproject.toml $(KERNEL)
	$(BIN)/python -m pip install --quiet --no-compile --editable '.[test,docs]'
	touch $(VENV)/.installed $@

clean:
	rm -rf $(VENV) build dist docs/_build $(OUT)
