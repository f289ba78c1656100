"""Keep optuna-dashboard's content of a study up to date while it runs, cheaply and without ever failing it."""

import threading
import time
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import optuna
from sqlalchemy.exc import SQLAlchemyError

from gtf_tune.display import definition_unit
from gtf_tune.pipelines.run import digest
from gtf_tune.report.aligned_runs import read_configuration
from gtf_tune.report.dashboard import notes
from gtf_tune.report.dashboard.notes import Attachment
from gtf_tune.report.dashboard.writer import DashboardWriter, artifact_folder, artifact_store, turn_to_write
from gtf_tune.report.study_data import StudyData, read_search, read_trials, runs_made
from gtf_tune.store import confirmations, runs, studies
from gtf_tune.store.database import Database
from gtf_tune.store.database.errors import storage_error
from gtf_tune.store.optuna.link import linked
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.study.events import Event, TrialFinished
from gtf_tune.study.outcome.export import FILE_NAMES, common_camera, options_files
from gtf_tune.version import __version__

REFRESH_S = 60.0
"""Seconds between two updates while a study runs."""

SHARE = 0.02
"""Largest share of the time that updates may take."""

_PATIENCE_S = 5.0
_CATCH_UP_S = 10.0


class DashboardSync:
    """Notes, figures and files that optuna-dashboard shows of one study.

    As a callback of a worker, `on_event` brings them up to date when a trial ends, at most every ``refresh_s`` seconds
    and for at most a fiftieth of the time. Nothing that goes wrong here reaches the study: ``warn`` gets the first
    fault, and no more.

    Parameters
    ----------
    artifacts
        Folder of the files; by default beside a SQLite file, and none on a server.
    """

    def __init__(
        self,
        database: Database,
        study_name: str,
        *,
        artifacts: Path | None = None,
        warn: Callable[[str], None] = lambda _: None,
        refresh_s: float = REFRESH_S,
    ) -> None:
        self._database = database
        self._name = study_name
        self._artifacts = artifacts
        self._warn = warn
        self._refresh_s = refresh_s
        self._due_at = 0.0
        self._has_warned = False
        self._writing = threading.Lock()
        self._writer: DashboardWriter | None = None

    def on_event(self, event: Event) -> None:
        """Write everything that is new when a trial has ended, unless that was done a short time ago."""
        if isinstance(event, TrialFinished) and time.monotonic() >= self._due_at:
            self._bring_up_to_date(0.0)

    def is_current(self) -> bool:
        """Return whether nothing has changed since the study's note and figures were written.

        Raises
        ------
        StorageError
            There is no such study, or the database does not answer.
        """
        return self._opened().written_for() == self._state()

    def bring_up_to_date(self) -> None:
        """Write everything as it stands now, also what other workers and those that died left out."""
        self._bring_up_to_date(_PATIENCE_S)

    def write_trial(self, number: int) -> None:
        """Write the note and the files of one trial.

        Raises
        ------
        StorageError
            There is no such trial, or the database does not answer.
        """
        data = read_trials(self._database, self._name, [0, number])
        trial = next(trial for trial in data.trials if trial.number == number)
        if trial.optuna_trial_id is None:
            return
        writer = self._opened()
        for attachment in self._trial_files(data, number) if writer.artifacts is not None else ():
            writer.write_trial_file(trial.optuna_trial_id, attachment)
        writer.write_trial_note(trial.optuna_trial_id, notes.trial_note(data, number))

    def write_study(self) -> None:
        """Write the note, the figures and the files of the study itself; only with the turn to do so.

        Raises
        ------
        StorageError
            There is no such study, or the database does not answer.
        """
        data, writer = read_search(self._database, self._name), self._opened()
        writer.write_headline(_metric_name(data), _facts(data))
        writer.write_study_note(notes.study_note(data, writer.study_note()))
        drawings, files = notes.key_figures(data), _study_files(data)
        for drawing in drawings:
            writer.write_figure(drawing)
        for attachment in files:
            writer.write_study_file(attachment)
        # What an earlier recommendation had, and this one has not.
        writer.remove_figures_except({drawing.name for drawing in drawings})
        writer.remove_study_files(set(FILE_NAMES) - {attachment.name for attachment in files})

    def _state(self) -> str:
        """Return a digest of what the note and the figures depend on."""
        study = studies.get(self._database, self._name)
        (facts,) = studies.summaries(self._database, study.id)
        return digest([__version__, len(confirmations.of_study(self._database, study.id)), *astuple(facts)])

    def _bring_up_to_date(self, patience_s: float) -> None:
        if not self._writing.acquire(blocking=patience_s > 0):
            return
        started = time.monotonic()
        try:
            self._guarded(lambda: self._write_trials(started + _CATCH_UP_S))
            self._guarded(lambda: self._write_study_in_turn(patience_s))
        finally:
            ended = time.monotonic()
            self._due_at = ended + max(self._refresh_s, (ended - started) / SHARE)
            self._writing.release()

    def _write_trials(self, give_up_at: float) -> None:
        """Write the trials that have no note, as long as there is time."""
        noted = self._opened().noted_trials()
        for trial in read_search(self._database, self._name).trials:
            if trial.state != "claimed" and trial.optuna_trial_id not in noted and time.monotonic() < give_up_at:
                self.write_trial(trial.number)

    def _write_study_in_turn(self, patience_s: float) -> None:
        study_id = studies.get(self._database, self._name).id
        with turn_to_write(self._database, study_id, patience_s) as mine:
            if mine:
                state = self._state()  # first: what changes meanwhile is then written again
                self.write_study()
                self._opened().set_written_for(state)

    def _trial_files(self, data: StudyData, number: int) -> list[Attachment]:
        own = [one for one in runs_made(data.runs) if one.number == number and one.run.status == "failed"]
        named = [
            (f"{one.sequence_name}, {one.run.kind} run {one.run.index}: {one.run.error}", one.run.key) for one in own
        ]
        settings = read_configuration(self._database, data, f"trial {number}", number)
        images = [notes.trajectory_image(one, name) for name, one in settings.items()]
        log = notes.failure_log((name, runs.log(self._database, key)) for name, key in named)
        return [one for one in (notes.matrix_table(data, number), *images, log) if one is not None]

    def _opened(self) -> DashboardWriter:
        if self._writer is None:
            storage = optuna_storage(self._database)
            record = linked(self._database, studies.get(self._database, self._name))
            study = optuna.load_study(
                study_name=storage.get_study_name_from_id(record.optuna_study_id),
                storage=storage,
                sampler=optuna.samplers.RandomSampler(seed=0),
                pruner=optuna.pruners.NopPruner(),
            )
            folder = artifact_folder(self._database, self._artifacts)
            self._writer = DashboardWriter(self._database, study, artifact_store(folder))
        return self._writer

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # the study matters more than its display, whatever is wrong with that
            if not self._has_warned:
                self._has_warned = True
                reason = storage_error(error, self._database.url) if isinstance(error, SQLAlchemyError) else error
                said = " ".join(str(reason).split())
                self._warn(f"optuna-dashboard could not be brought up to date, all else goes on ({said})")


def _study_files(data: StudyData) -> list[Attachment]:
    """Return the table of trials, and the options to use in the forms that users paste, where there are any."""
    trial, camera = data.recommendation.trial, common_camera(data.definition, (*data.sequences, *data.holdouts))
    exported = options_files(data.definition, trial.options or {}, camera) if trial else {}
    files = [Attachment(name, "text/plain", content.encode()) for name, content in exported.items()]
    return [notes.trial_table(data), *files]


def _facts(data: StudyData) -> dict[str, str]:
    return {
        "read first": f"the page Note: /dashboard/studies/{data.study.optuna_study_id}/note",
        "pipeline": data.definition.pipeline.name,
        "sequences": ", ".join(sequence.name for sequence in data.sequences),
        "verdict": data.recommendation.headline,
    }


def _metric_name(data: StudyData) -> str:
    unit = definition_unit(data.definition)
    if data.has_several_sequences:
        return f"{unit.name} / nominal"
    return f"{unit.name} / extent" if unit.factor != 1 else unit.label
