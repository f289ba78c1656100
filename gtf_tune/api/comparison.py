"""Compare systems from Python."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from gtf_tune.api.defaults import storage_or_default
from gtf_tune.api.executor import executor_here
from gtf_tune.definition import GtfDefinition, LimitsDefinition
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.pipelines import OptionValue
from gtf_tune.sequence import FEWEST_FRAMES, load_sequence
from gtf_tune.store.database import create_database
from gtf_tune.study.runs.run_source import RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.systems import System, SystemComparison, compare_systems, read_system


def compare(
    sequence: str | os.PathLike[str],
    systems: Sequence[str | os.PathLike[str]] | Mapping[str, Mapping[str, OptionValue]],
    *,
    pipeline: str = "glomap",
    settings: Mapping[str, object] | None = None,
    gtf: Mapping[str, Any] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    storage: str | os.PathLike[str] | None = None,
) -> SystemComparison:
    """Compare systems on one sequence under the same noise, each with the first; runs are stored and reused.

    Parameters
    ----------
    sequence
        Folder of images or data set in any known layout.
    systems
        Names of pipelines, definitions (TOML) or files of options (JSON); or options by the name of a configuration.
    pipeline, settings
        The pipeline that options are for, and its settings that are no options.
    gtf
        The section of a study definition, such as ``{"noisy_runs": 8, "noise_sigma": 2.0}``.
    seed
        Seed of noise and runs.
    jobs
        How many runs go side by side; by default one for each core.
    storage
        File or database URL; by default that of GTF_TUNE_STORAGE, else ``gtf-tune.db`` in the current folder.

    Raises
    ------
    GtfTuneError
        The images cannot be read, there are fewer than two systems, or one of them is unknown.
    """
    if isinstance(systems, Mapping):
        base = read_system(pipeline, settings=settings)
        chosen = [System(name, base.pipeline, base.pipeline.options.check(given)) for name, given in systems.items()]
    else:
        chosen = [read_system(os.fspath(system), pipeline, settings) for system in systems]
    definition = section_from_dict(GtfDefinition, gtf or {}, "gtf")
    loaded = load_sequence(sequence, fewest=FEWEST_FRAMES)
    database = create_database(storage_or_default(storage))
    try:
        with executor_here(jobs) as executor:
            source = RunSource(database, executor, run_limits(LimitsDefinition()), StopRequest())
            return compare_systems(chosen, loaded, definition, seed, source)
    finally:
        database.close()
