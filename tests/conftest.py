"""Keep tests away from the user's cache and settings, and from chance and the clock."""

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

# The same examples everywhere, however slow the machine: elsewhere Hypothesis draws others each time, and fails an
# example of more than 0.2 s.
settings.register_profile(
    "steady", derandomize=True, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")


# What an environment may hold that changes where commands write and how their tables look.
UNWANTED = (
    "GTF_TUNE_STORAGE",
    "GTF_TUNE_DATA_ROOT",
    "FORCE_COLOR",
    "NO_COLOR",
    "PY_COLORS",
    "GITHUB_ACTIONS",
    "TERMINAL_WIDTH",
    "TTY_COMPATIBLE",
)


@pytest.fixture(scope="session", autouse=True)
def _own_environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GTF_TUNE_CACHE_DIR", str(tmp_path_factory.getbasetemp() / "cache"))
        patch.setenv("COLUMNS", "80")
        for name in UNWANTED:
            patch.delenv(name, raising=False)
        yield
