import pytest


@pytest.fixture(scope="session", autouse=True)
def kernel_cache_of_its_own(tmp_path_factory):
    """Kernels compiled by tests stay out of the user's cache, and no test reads what an earlier run left."""
    patch = pytest.MonkeyPatch()
    patch.setenv("PEPPER_KIN_CACHE", str(tmp_path_factory.mktemp("kernels")))
    yield
    patch.undo()
