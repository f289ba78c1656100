"""Compare systems, and check options that were tuned elsewhere, from Python."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from gtf_tune.api.defaults import storage_or_default
from gtf_tune.api.executor import executor_here
from gtf_tune.definition import GtfDefinition, LimitsDefinition, read_options
from gtf_tune.definition.loading import section_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue
from gtf_tune.sequence import FEWEST_FRAMES, load_sequence
from gtf_tune.store.database import create_database
from gtf_tune.study.check_options import OptionCheck, check_options, systems_like
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
    with _runs(storage, jobs) as source:
        return compare_systems(chosen, loaded, definition, seed, source)


def check(
    sequence: str | os.PathLike[str],
    options: Mapping[str, OptionValue] | str | os.PathLike[str] | None = None,
    *,
    like: str | None = None,
    pipeline: str = "glomap",
    settings: Mapping[str, object] | None = None,
    gtf: Mapping[str, Any] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    storage: str | os.PathLike[str] | None = None,
) -> OptionCheck:
    """Check whether options that were tuned elsewhere hold on a sequence, with as few runs as that takes.

    Parameters
    ----------
    sequence
        Folder of images or data set in any known layout.
    options
        Options by name, or a file of them (JSON); by default those that the study ``like`` adopted.
    like
        A study of the storage whose pipeline, nominal options and noise to take.
    pipeline, settings, gtf
        The pipeline, its settings that are no options, and the section of a study definition, without ``like``. The
        number of noisy runs follows from the looks.
    seed
        Seed of noise and runs.
    jobs
        How many runs go side by side; by default one for each core.
    storage
        File or database URL; by default that of GTF_TUNE_STORAGE, else ``gtf-tune.db`` in the current folder.

    Raises
    ------
    GtfTuneError
        The images cannot be read, there are no options, one of them is unknown, or there is no such study.
    """
    if options is None and like is None:
        raise DefinitionError("there are no options to check; give some, or the study whose adopted options to take")
    loaded = load_sequence(sequence, fewest=FEWEST_FRAMES)
    with _runs(storage, jobs) as source:
        if like is None:
            nominal = read_system(pipeline, settings=settings)
            score = section_from_dict(GtfDefinition, gtf or {}, "gtf")
        else:
            nominal, checked, score = systems_like(source.database, like, None)
        if options is not None:
            checked = replace(nominal, name="options", options=_options(nominal, options))
        return check_options(nominal, checked, loaded, score, seed, source)


def _options(nominal: System, given: Mapping[str, OptionValue] | str | os.PathLike[str]) -> Mapping[str, OptionValue]:
    found = given if isinstance(given, Mapping) else read_options(Path(given))
    return nominal.pipeline.options.check({**nominal.options, **found})


@contextmanager
def _runs(storage: str | os.PathLike[str] | None, jobs: int | None) -> Iterator[RunSource]:
    """Yield what makes runs and stores them."""
    database = create_database(storage_or_default(storage))
    try:
        with executor_here(jobs) as executor:
            yield RunSource(database, executor, run_limits(LimitsDefinition()), StopRequest())
    finally:
        database.close()
