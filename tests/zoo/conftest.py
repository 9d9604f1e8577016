"""Sizes, generators and counts of `tests/fuzz`, which these tests use as they are."""

import importlib.util
from pathlib import Path

spec = importlib.util.spec_from_file_location(
    "fuzz_conftest", Path(__file__).parents[1] / "fuzz" / "conftest.py"
)
assert spec is not None
assert spec.loader is not None
fuzz = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fuzz)
fuzz.HERE = Path(__file__).parent  # whose variables are kept where a case fails

amount, rng, tried = fuzz.amount, fuzz.rng, fuzz.tried
pytest_runtest_call = fuzz.pytest_runtest_call
pytest_runtest_makereport = fuzz.pytest_runtest_makereport
