"""Write notes, figures and files into the places where optuna-dashboard finds them, one process at a time."""

import io
import json
import time
import uuid
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import optuna
import optuna_dashboard
from optuna.artifacts import FileSystemArtifactStore
from optuna.artifacts.exceptions import ArtifactNotFound
from optuna.exceptions import ExperimentalWarning
from optuna.storages import BaseStorage
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from gtf_tune.operating_system import opened_folder, try_lock
from gtf_tune.report.dashboard.notes import Attachment
from gtf_tune.report.drawing import theme
from gtf_tune.report.drawing.markup import figure_id
from gtf_tune.report.panels.base import Drawing
from gtf_tune.store.database import Database
from gtf_tune.store.database.schema import advisory_transaction
from gtf_tune.store.optuna.tables import forget_attributes
from gtf_tune.store.optuna.trials import TrialHandle, storage_of, study_id_of

_ADVISORY_LOCK = 0x6774_6674 << 32
_PAUSE_S = 0.05


def artifact_folder(database: Database, given: Path | None = None) -> Path | None:
    """Return the folder of artifacts: the given one, or ``FILE-artifacts`` beside a SQLite file; None for a server."""
    if given is not None or database.url.get_backend_name() != "sqlite":
        return given
    path = Path(str(database.url.database))
    return path.with_name(f"{path.name}-artifacts")


def artifact_store(folder: Path | None) -> FileSystemArtifactStore | None:
    """Return Optuna's store for a folder, which is made if need be; None where there is none.

    Raises
    ------
    OSError
        The folder cannot be made.
    """
    if folder is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    return FileSystemArtifactStore(folder)


@contextmanager
def turn_to_write(database: Database, study_id: int, patience_s: float = 0.0) -> Iterator[bool]:
    """Take the lock on the dashboard's content of a study for the length of a context; yield whether it was free.

    Waits at most ``patience_s``. A process that dies loses the lock. On SQLite the lock is on the folder of the file:
    a second handle of the file itself would drop SQLite's own locks.
    """
    if database.url.get_backend_name() == "sqlite":
        with _locked_folder(Path(str(database.url.database)).resolve().parent, patience_s) as mine:
            yield mine
        return
    key = _ADVISORY_LOCK + study_id
    turn = advisory_transaction(database.engine)
    connection = turn.__enter__()
    take = text("SELECT pg_try_advisory_xact_lock(:key)")
    try:
        yield _within(patience_s, lambda: bool(connection.scalar(take, {"key": key})))
    finally:
        with suppress(DBAPIError):  # a server that dropped the connection has released the lock already
            turn.__exit__(None, None, None)


@contextmanager
def _locked_folder(folder: Path, patience_s: float) -> Iterator[bool]:
    with opened_folder(folder) as handle:
        yield _within(patience_s, lambda: try_lock(handle))


def _within(patience_s: float, attempt: Callable[[], bool]) -> bool:
    give_up_at = time.monotonic() + patience_s
    while not attempt():
        if time.monotonic() >= give_up_at:
            return False
        time.sleep(_PAUSE_S)
    return True


_NAMESPACE = uuid.UUID("9f0c7a52-3d0b-5c1e-8e43-6a1d6f4f2b77")
_WRITTEN_FOR = "gtf-tune:written-for"
_FIGURES = "dashboard:plot_data:"
_MOST_HOVERED = 300
_DIGITS = 6


@dataclass(frozen=True)
class DashboardWriter:
    """Writer of the dashboard's content of one Optuna study; writing the same thing twice changes nothing."""

    database: Database
    study: optuna.Study
    artifacts: FileSystemArtifactStore | None = field(repr=False)

    @property
    def storage(self) -> BaseStorage:
        """Return Optuna's storage."""
        return storage_of(self.study)

    @property
    def study_id(self) -> int:
        """Return the database id of the Optuna study."""
        return study_id_of(self.study)

    def write_headline(self, metric: str, facts: Mapping[str, str]) -> None:
        """Set the name of the metric, and short facts that the list of studies shows."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            self.study.set_metric_names([metric])
        for name, value in facts.items():
            self.study.set_user_attr(name, value)

    def write_study_note(self, body: str) -> None:
        """Replace the note of the study."""
        optuna_dashboard.save_note(self.study, body)

    def study_note(self) -> str:
        """Return the note of the study as it stands."""
        body: str = optuna_dashboard.get_note(self.study)
        return body

    def write_trial_note(self, trial_id: int, body: str) -> None:
        """Replace the note of a trial."""
        optuna_dashboard.save_note(TrialHandle(self.study, self.storage, trial_id), body)

    def noted_trials(self) -> set[int]:
        """Return the ids of the trials that have a note."""
        # optuna-dashboard numbers the versions of a note under this name.
        parts = (key.split(":") for key in self.storage.get_study_system_attrs(self.study_id))
        return {int(part[1]) for part in parts if len(part) == 3 and part[0] == "dashboard" and part[2] == "note_ver"}

    def written_for(self) -> str:
        """Return the state of the study for which its note and figures were written last; empty if never."""
        return str(self.storage.get_study_system_attrs(self.study_id).get(_WRITTEN_FOR, ""))

    def set_written_for(self, state: str) -> None:
        """Keep the state of the study for which its note and figures are written now."""
        self.storage.set_study_system_attr(self.study_id, _WRITTEN_FOR, state)

    def write_figure(self, drawing: Drawing) -> None:
        """Replace the figure of this name."""
        figure = small(theme.titled(drawing.figure, escape(drawing.title or drawing.name.capitalize())))
        optuna_dashboard.save_plotly_graph_object(self.study, figure, graph_object_id=f"gtf-{figure_id(drawing.name)}")

    def remove_figures_except(self, kept: Collection[str]) -> None:
        """Remove the figures that were written earlier under other names than these."""
        known = {f"{_FIGURES}gtf-{figure_id(name)}" for name in kept}
        attributes = self.storage.get_study_system_attrs(self.study_id)
        written = [key for key in attributes if key.startswith(f"{_FIGURES}gtf-")]
        stale = [key for key in written if key.rpartition(":")[0] not in known]
        forget_attributes(self.database, self.study_id, stale)

    def remove_study_files(self, names: Collection[str]) -> None:
        """Remove files of the study, by their names, as far as they exist."""
        identities = [self._identity("study", name) for name in names]
        if self.artifacts is not None:
            for identity in identities:
                with suppress(ArtifactNotFound):
                    self.artifacts.remove(identity)
        forget_attributes(self.database, self.study_id, [f"artifacts:{identity}" for identity in identities])

    def write_study_file(self, attachment: Attachment) -> None:
        """Replace the file of this name of the study."""
        self._write_file(attachment, "study", "artifacts:")

    def write_trial_file(self, trial_id: int, attachment: Attachment) -> None:
        """Replace the file of this name of a trial.

        Its record is kept with the study, where optuna-dashboard looks too: Optuna does not allow changes of a finished
        trial.
        """
        self._write_file(attachment, str(trial_id), f"dashboard:artifacts:{trial_id}:")

    def _write_file(self, attachment: Attachment, owner: str, prefix: str) -> None:
        if self.artifacts is None:
            return
        # The same file always has the same id, so that writing it again replaces it.
        identity = self._identity(owner, attachment.name)
        self.artifacts.write(identity, io.BytesIO(attachment.content))
        record = {"artifact_id": identity, "filename": attachment.name, "mimetype": attachment.media_type}
        self.storage.set_study_system_attr(self.study_id, prefix + identity, json.dumps({**record, "encoding": None}))

    def _identity(self, owner: str, name: str) -> str:
        return str(uuid.uuid5(_NAMESPACE, f"{self.study.study_name}/{self.study_id}/{owner}/{name}"))


def small(figure: Any) -> Any:
    """Return a figure that takes little space in the database: six digits, hover texts only where points are few."""
    for trace in figure.data:
        if trace.hovertext is not None and len(trace.x if trace.x is not None else ()) > _MOST_HOVERED:
            trace.update(hovertext=None, hoverinfo="x+y")
        for name in ("x", "y"):
            if trace[name] is not None and all(isinstance(value, float) for value in trace[name]):
                trace[name] = [float(f"{value:.{_DIGITS}g}") for value in trace[name]]
    return figure
