# Every target works on a fresh clone with nothing but Python 3.11+ and a C compiler:  make demo,  make test
PYTHON ?= python3
VENV ?= .venv
LAYOUT = $(if $(filter Windows_NT,$(OS)),Scripts,bin)
EXE = $(if $(filter Windows_NT,$(OS)),.exe)
BIN = $(VENV)/$(LAYOUT)
VENV_PYTHON = $(BIN)/python$(EXE)
PIP = $(BIN)/python -m pip install --quiet
CBUILD = build/c

.PHONY: demo test test-plain-c test-lowest lint test-c docs dist clean

demo: $(VENV_PYTHON)
	@echo 'Installing rsdeblur and the libraries it needs into $(VENV): a minute or more.'
	$(BIN)/python -m pip install .
	$(BIN)/rsdeblur demo -v --force -o demo-output

# The C code is compiled and tested while pip works, which takes one processor.
test: $(VENV_PYTHON)
	$(PIP) 'meson>=1.4' ninja
	$(PIP) '.[test]' & pip=$$!; $(MAKE) test-plain-c; c=$$?; wait $$pip && exit $$c
	$(PYTEST)

test-plain-c:
	$(call run-c,plain,)

# A few tests, which use every dependency, on the lowest versions of the dependencies, in an environment of their own.
test-lowest: override VENV = build/lowest
test-lowest:
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	$(PYTHON) -c '$(LOWEST)' >$(VENV)/lowest.txt
	$(PIP) '.[test]' -r $(VENV)/lowest.txt
	$(PYTEST) $(LOWEST_TESTS)

lint: $(VENV_PYTHON)
	$(PIP) '.[lint,test]'
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/codespell
	$(BIN)/numpydoc lint rsdeblur/*.py rsdeblur/*/*.py

# The C test program: plain, under sanitizers, and under valgrind where that is installed. Sanitizers check what the
# source does; optimised as strongly as the plain build, which valgrind runs, they take four times as long to compile.
test-c: $(VENV_PYTHON)
	$(PIP) 'meson>=1.4' ninja
	$(call run-c,plain,)
	$(call run-c,sanitize,-Db_sanitize=address$(comma)undefined -Db_lundef=false -Dc_args=-O1)
	if command -v valgrind; then \
	  $(MESON) test -C $(CBUILD)/plain --timeout-multiplier 10 --wrap 'valgrind --quiet --leak-check=full --error-exitcode=1'; fi

# The documentation site, in site/.
docs: $(VENV_PYTHON)
	$(PIP) '.[docs,video]'
	$(BIN)/python -P -m sphinx -W --keep-going -n -q -b html docs site

# The source distribution, the wheel made of it, and that wheel in an empty environment without any compiler.
dist: $(VENV_PYTHON)
	$(PIP) build
	rm -rf dist build/empty
	$(BIN)/python -m build -o dist
	$(PYTHON) -m venv build/empty
	build/empty/$(LAYOUT)/python -m pip install --quiet --only-binary :all: dist/*.whl
	env -i PATH="$(abspath build/empty/$(LAYOUT))" CC=/bin/false HOME="$(abspath build/empty)" \
	  rsdeblur demo --size 320x240 -o "$(abspath build/empty/demo)"

clean:
	rm -rf $(VENV) build dist site docs/generated demo-output .mypy_cache .pytest_cache .ruff_cache

$(VENV_PYTHON):
	$(PYTHON) -c 'import sys; sys.exit("rsdeblur needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

# Safe path: programs that tests start here must find the installed package, not the bare source folder.
PYTEST = PYTHONSAFEPATH=1 $(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder
LOWEST_TESTS = $(addprefix tests/,cli/test_camera.py cli/test_commands.py deconv/test_fft.py image/test_encoded.py \
  io/test_pictures.py kernels/test_laws.py kernels/test_twins.py motion/test_track.py)
# Print name==lowest for each name>=lowest of the dependencies that every user needs.
LOWEST = import tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
  print(*(each.replace(">=", "==") for each in project["dependencies"]), sep="\n")
comma = ,
MESON = NINJA="$(abspath $(BIN)/ninja$(EXE))" $(BIN)/meson
# run-c(folder, options): build all C code anew, warnings as errors, and run its test program.
define run-c
rm -rf $(CBUILD)/$(1)
$(MESON) setup $(CBUILD)/$(1) -Dwerror=true $(2)
$(MESON) compile -C $(CBUILD)/$(1)
$(MESON) test -C $(CBUILD)/$(1) --print-errorlogs
endef
