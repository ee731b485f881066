# The commands that CI runs, by name; CONTRIBUTING.md has the same ones for those without just.

# list the commands
default:
    @just --list

# lint, format and layers
lint:
    ruff check
    ruff format --check
    lint-imports

# mend what lint can mend by itself
fix:
    ruff check --fix
    ruff format

# static types of src, then of tests, tools and benchmarks
types:
    mypy
    mypy --config-file tests/mypy.ini
    mypy --config-file tools/mypy.ini

# all tests
test *options:
    pytest {{ options }}

# the long sweeps, of which the tests take a sample
slow *options:
    pytest -m slow {{ options }}

# all tests, and which lines they reach; twice as long
coverage:
    pytest --cov --cov-report=term --cov-fail-under=85

# the API page from the code, then every link, anchor and command of the documents
docs:
    python tools/build_api_page.py
    pytest tests/test_docs.py tests/test_api_page.py

# the paper's evaluation on the built-in homes
bench *options:
    cartier bench paper -o run {{ options }}

# all that CI runs, in virtual environments of its own
ci:
    bash .ci/run
