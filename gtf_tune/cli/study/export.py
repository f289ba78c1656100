"""Write options in the forms that people paste back into their tools."""

import contextlib
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, open_storage
from gtf_tune.cli.study.true_errors import TrueErrors
from gtf_tune.cli.terminal.console import say, write_text

if TYPE_CHECKING:
    from gtf_tune.store.database import Database
    from gtf_tune.store.runs import TrialRun
    from gtf_tune.store.studies import Study
    from gtf_tune.store.trials import Trial

Format = Annotated[
    str | None, typer.Option("--format", "-f", help="colmap (a folder of scripts), colmap-cli, json, csv or tum.")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", help="A file (default stdout); for colmap and tum a folder (default STUDY-trial-N)."
    ),
]
TrialNumber = Annotated[
    int | None, typer.Option("--trial", min=0, max=10**9, help="Another trial than the recommended one.")
]


def export(
    name: StudyName,
    format_: Format = None,
    output: Output = None,
    trial: TrialNumber = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Write what reconstructs with the options to use; these as COLMAP's commands or JSON; trials as CSV; trajectories.

    For COLMAP's pipelines the default is a folder with run.py, run.sh and options.json, as 'gtf-tune tune' leaves it.

    Example: gtf-tune study export photos -o photos-tuned/
    """
    from gtf_tune.errors import DefinitionError
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome import export as export_module

    if format_ is not None and format_ not in export_module.FORMATS:
        raise DefinitionError(f"--format takes one of {', '.join(export_module.FORMATS)}, not '{format_}'")
    if format_ == "csv" and trial is not None:
        raise DefinitionError("--format csv writes all trials; drop --trial, or take --format json for one of them")
    database = open_storage(storage)
    study = studies.get(database, name)
    pipeline = stored_definition(study).pipeline.name
    format_ = format_ or export_module.formats_of(pipeline)[0]
    if format_ == "csv":
        _deliver(_trials_csv(database, study), output)
        return
    chosen = _choose(database, study, trial)
    if format_ == "colmap":
        export_module.check_format(format_, pipeline)
        _write_scripts(database, chosen, name, output or Path(f"{name}-trial-{chosen.number}"))
        return
    if format_ == "tum":
        _write_trajectories(database, chosen, output or Path(f"{name}-trial-{chosen.number}"))
        return
    definition = stored_definition(study)
    camera = export_module.common_camera(definition, studies.sequences(database, study.id))
    text = export_module.options_text(format_, definition, chosen.options or {}, camera)
    _deliver(text, output)


def _choose(database: "Database", study: "Study", number: int | None) -> "Trial":
    """Return the trial that was asked for, else the one to use; `StorageError` where none is."""
    from gtf_tune.errors import StorageError
    from gtf_tune.store import trials
    from gtf_tune.study.outcome.recommendation import recommend, require_trial

    if number is not None:
        return trials.get(database, study.id, number)
    found = recommend(database, study)
    if found.trial is None and found.evidence.best is not None:
        raise StorageError(
            f"{found.headline}: see 'gtf-tune study best {study.name}', or name a trial to write with --trial N"
        )
    trial = require_trial(database, study, found)
    say(found.text)
    say(f"writing trial {trial.number}")
    return trial


def _trials_csv(database: "Database", study: "Study") -> str:
    from gtf_tune.store import ground_truth_errors, trials
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome import export as export_module

    known = trials.of_study(database, study.id)
    truth = TrueErrors(stored_definition(study).side_metric, ground_truth_errors.values(database, study.id))
    versions = trials.version_mismatches(database, study.id)
    names = list(dict.fromkeys(option for trial in known for option in trial.options or {}))
    sequences = sorted(truth.sequences)
    facts = ("state", "feasible", "value", "standard_error", "ci_low", "ci_high", "coverage")
    more = ("collapsed_rate", "clean_runs", "noisy_runs", "wall_s", "message")
    known_facts = attrgetter(*facts, *more)
    rows = [
        [
            trial.number,
            *known_facts(trial),
            versions.get(trial.number),
            *(truth.value(trial.number, sequence) for sequence in sequences),
            *((trial.options or {}).get(option) for option in names),
        ]
        for trial in known
    ]
    columns = [
        "ordinal",
        *facts,
        *more,
        "version_mismatch",
        *(f"{truth.side.key}:{sequence}" for sequence in sequences),
        *names,
    ]
    return export_module.table_csv(columns, rows)


def _write_scripts(database: "Database", trial: "Trial", name: str, folder: Path) -> None:
    from gtf_tune.study.open_study import open_study
    from gtf_tune.study.outcome.recommendation import recommend
    from gtf_tune.study.tune.handover import write_scripts
    from gtf_tune.study.tune.start import configurations_of, whole_sequence

    study = open_study(database, name)
    whole = whole_sequence(study)
    adopted = recommend(database, study.record)
    confirmed = adopted.decision == "adopt" and adopted.trial == trial
    label = "ADOPTED options, confirmed on fresh noise" if confirmed else "not confirmed on fresh noise"
    label = f"trial {trial.number} of study '{name}': {'NOMINAL options' if not trial.number else label}"
    write_scripts(folder, whole, study.pipeline, configurations_of(study, trial, whole, label))
    say(f"wrote {folder}; next: python {folder / 'run.py'}, or sh {folder / 'run.sh'}")


def _write_trajectories(database: "Database", trial: "Trial", folder: Path) -> None:
    from gtf_tune.store import runs
    from gtf_tune.store.runs import trajectories
    from gtf_tune.trajectory import write_tum

    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    uses = runs.of_trial(database, trial.id)
    found = trajectories(database, [use.run.key for use in uses])
    for use in uses:
        if len(found[use.run.key]):
            write_tum(found[use.run.key], folder / _file_name(use))
    say(f"wrote the trajectories of trial {trial.number} to {folder}")


def _file_name(use: "TrialRun") -> str:
    """Return the name of the file of a run; what the database says is not trusted to stay in the folder."""
    from gtf_tune.definition.model import check_name
    from gtf_tune.errors import StorageError

    try:
        return f"{check_name(use.sequence_name)}-{check_name(use.run.kind)}-{use.run.index:02d}.txt"
    except ValueError as error:
        raise StorageError(
            f"the storage names a sequence or a kind of run {error}; somebody changed it with other tools"
        ) from error


def _deliver(text: str, output: Path | None) -> None:
    if output is None:
        write_text(text)
        return
    with _writing(output):
        output.write_text(text, encoding="utf-8", errors="surrogateescape")
    say(f"wrote {output}")


@contextlib.contextmanager
def _writing(place: Path) -> Iterator[None]:
    from gtf_tune.errors import StorageError

    try:
        yield
    except OSError as error:
        raise StorageError(f"cannot write {place} ({error.strerror}); choose another place with --output") from error
