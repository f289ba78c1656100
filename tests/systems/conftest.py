"""What the tests of real systems share: the Python that `make test-systems` installed them into, and one run."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence

SYSTEMS = Path(__file__).parents[2] / "examples" / "systems"
RunSystem = Callable[..., RunOutcome]


def python_of(name: str) -> Path:
    """Return the Python of a system's environment, or skip the test."""
    found = Path(os.environ.get("GTF_TUNE_SYSTEMS", "/nowhere"), name, "bin", "python")
    if not found.exists():
        pytest.skip(f"{name} is not installed: make test-systems")
    return found


@pytest.fixture
def run_system() -> RunSystem:
    """Return a function that runs the definition of a system once on a sequence without noise."""

    def run(name: str, sequence: Sequence, options: dict[str, object], **settings: str) -> RunOutcome:
        definition = str(SYSTEMS / name / f"{name}.toml")
        pipeline = create_pipeline("command", {"definition": definition, "python": str(python_of(name)), **settings})
        request = RunRequest(pipeline, pipeline.options.check(options), sequence, "clean", 0, 0.0, 0, 0)
        return InlineExecutor().submit(request, RunLimits(600.0, 2**34)).result()

    return run
