"""A stored study in Python: run it, confirm its best configurations, and look at what it found."""

import contextlib
import logging
import threading
import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import optuna

from gtf_tune.api.executor import executor_here
from gtf_tune.definition import StudyDefinition
from gtf_tune.display import definition_unit
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.enqueued import numbers_of
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.studies import stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.edit import Extension, extend_study
from gtf_tune.study.enqueue import enqueue
from gtf_tune.study.events import Callback, Event, summary
from gtf_tune.study.open_study import OpenStudy, defined_budget, open_study
from gtf_tune.study.outcome.confirm import DEFAULT_RUNS, DEFAULT_TOP, confirm, plan_confirmation
from gtf_tune.study.outcome.improvement import Improvement
from gtf_tune.study.outcome.recommendation import Decision, recommend, require_trial
from gtf_tune.study.outcome.verdict import Verdict
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest, signals_to
from gtf_tune.study.states import reopen_study
from gtf_tune.study.tune.phases import Means, tune_through
from gtf_tune.study.work.worker import StudyWorker

if TYPE_CHECKING:
    import pandas
    from plotly.graph_objects import Figure

_log = logging.getLogger("gtf_tune")

_COLUMNS = (
    *("number", "state", "feasible", "value", "standard_error", "ci_low", "ci_high", "coverage", "collapsed_rate"),
    *("clean_runs", "noisy_runs", "wall_s", "message"),
)


@dataclass(frozen=True)
class BestTrial:
    """The trial of a study to use.

    Attributes
    ----------
    number
        Its number; 0 is the nominal trial.
    options
        Its value of every searched option.
    value
        Its score, smaller is more precise: a fraction of the trajectory's extent by default, the ratio to nominal for
        studies of several sequences.
    decision
        ``adopt`` or ``keep nominal`` after a confirmation; ``unconfirmed`` or ``nothing better`` before.
    improvement
        How much smaller its errors are than those of nominal, with a 95 % interval: on fresh noise where it was
        adopted, else in the search, which flatters the best of many.
    text
        The decision and its reasons in sentences.
    """

    number: int
    options: Mapping[str, OptionValue]
    value: float
    decision: Decision
    improvement: Improvement
    text: str


class Study:
    """A study in a storage, as `gtf_tune.create_study` and `gtf_tune.open_study` return it.

    The storage is the truth: other programs, ``gtf-tune study`` among them, may work on the same study, and every
    attribute is read anew. Progress goes to the logger ``gtf_tune`` at level INFO.
    """

    def __init__(self, database: Database, name: str, access: "Access") -> None:
        studies.get(database, name)
        self.name = name
        self._database = database
        self._access = access
        self._opened: OpenStudy | None = None
        self._close = weakref.finalize(self, database.close)

    def __repr__(self) -> str:
        return f"Study('{self.name}', storage='{self.storage}')"

    @property
    def definition(self) -> StudyDefinition:
        """What is searched, on what, how it is scored, and the budget."""
        return stored_definition(studies.get(self._database, self.name))

    @property
    def storage(self) -> str:
        """The storage, without its password."""
        return self._database.shown_url

    def close(self) -> None:
        """Close the connections to the storage; happens by itself when the study is no longer used."""
        self._close()

    def run(self, trials: int | None = None, *, jobs: int | None = None, trial_parallel: int = 1) -> "Study":
        """Work on the study here until its trials are done, and return the study.

        Finished runs are kept whatever happens: calling it again goes on where it stopped. Other processes may work on
        the same study.

        Parameters
        ----------
        trials
            Total number of trials, nominal and enqueued ones included, which becomes that of the study; by default what
            it has. Where as many are there already, no further one begins.
        jobs
            How many runs go side by side; by default one for each core.
        trial_parallel
            How many trials go side by side; more than 1 changes what samplers know when they choose.

        Raises
        ------
        GtfTuneError
            The images or the pipeline are missing here or differ from those that the study began with.
        KeyboardInterrupt
            Someone pressed Ctrl-C: once finishes the runs in flight, twice stops at once.
        """
        if trials is not None:
            self._set_budget(trials)
        reopen_study(self._database, self.name)
        study = self._open()
        with _interruptible() as stop, executor_here(jobs) as executor:
            StudyWorker(study, executor, stop, [_logged(study)]).work(trial_parallel)
        if stop.level:
            raise KeyboardInterrupt
        return self

    def tune(self, trials: int | None = None, *, jobs: int | None = None) -> "Study":
        """Search, put options of the best trial that carry nothing back to nominal, confirm, and return the study.

        This is what ``gtf-tune tune`` does once its study exists, without its minutes. Calling it again goes on.

        Parameters
        ----------
        trials, jobs
            As `run` takes them.

        Raises
        ------
        GtfTuneError
            As `run` and `confirm` do.
        KeyboardInterrupt
            Someone pressed Ctrl-C; finished runs are kept.
        """
        if trials is not None:
            self._set_budget(trials)
        reopen_study(self._database, self.name)
        study = self._open()
        with _interruptible() as stop, executor_here(jobs) as executor:
            try:
                tune_through(study, Means(executor, stop, [_logged(study)], _log.info))
            except Interrupted:
                raise KeyboardInterrupt from None
        if stop.level:
            raise KeyboardInterrupt
        return self

    def confirm(self, *, top: int = DEFAULT_TOP, noisy_runs: int = DEFAULT_RUNS, jobs: int | None = None) -> Verdict:
        """Run nominal and the best configurations on noise that the search never saw, and return the verdict.

        The best of many trials was chosen for its luck too; only what is better on fresh noise is adopted.

        Parameters
        ----------
        top
            How many of the best configurations, besides nominal.
        noisy_runs
            Fresh noisy runs of each configuration and sequence.
        jobs
            How many runs go side by side; by default one for each core.

        Raises
        ------
        GtfTuneError
            The nominal trial is not complete, or no trial is feasible.
        KeyboardInterrupt
            Someone pressed Ctrl-C; finished runs are kept.
        """
        study = self._open()
        plan = plan_confirmation(study, {}, top=top, noisy_runs=noisy_runs)
        with _interruptible() as stop, executor_here(jobs) as executor:
            source = RunSource(
                self._database, executor, run_limits(study.definition.limits), stop, _logged(study), study.nominal_run
            )
            try:
                return confirm(study, plan, source)
            except Interrupted:
                raise KeyboardInterrupt from None

    def enqueue(self, options: Mapping[str, object]) -> int:
        """Append a trial with these options, raise the total by one, and return its number; `run` takes it up next.

        Parameters
        ----------
        options
            Values of searched options; those that are not named have their nominal values.

        Raises
        ------
        OptionError
            There is no such option, or the value lies outside of what is searched.
        """
        return enqueue(self._database, self.name, options)

    @property
    def best(self) -> BestTrial:
        """The trial to use: the one that the confirmation supports; before it, the feasible one with the best score.

        Raises
        ------
        StorageError
            There is no feasible trial yet, or the confirmation rejects all of them.
        """
        record = studies.get(self._database, self.name)
        found = recommend(self._database, record)
        trial = require_trial(self._database, record, found)
        value = float("nan") if trial.value is None else trial.value
        return BestTrial(trial.number, dict(trial.options or {}), value, found.decision, found.improvement, found.text)

    @property
    def trials(self) -> list[Trial]:
        """All trials so far by number, those in work among them."""
        return trials.of_study(self._database, studies.get(self._database, self.name).id)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the trials as a pandas data frame: a row for each trial, a column ``options.NAME`` for each option.

        Raises
        ------
        DefinitionError
            pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise DefinitionError(
                "to_dataframe needs the package 'pandas', which gtf-tune does not; run pip install pandas, or take the "
                "list of trials from the attribute 'trials'"
            ) from error
        rows = [
            {name: getattr(trial, name) for name in _COLUMNS}
            | {f"options.{name}": value for name, value in (trial.options or {}).items()}
            for trial in self.trials
        ]
        return pandas.DataFrame(rows) if rows else pandas.DataFrame(columns=list(_COLUMNS))

    def plot(self, panel: str = "options", figure: str = "") -> "Figure":
        """Return a figure of the report of the study, as a Plotly figure.

        Parameters
        ----------
        panel
            Which panel of the report: ``options``, ``search``, ``matrices``, ``trajectories``, ``coverage`` ...
        figure
            Of several figures in a panel the first whose name or title has this text, such as the name of an option.

        Raises
        ------
        DefinitionError
            There is no such panel or figure, or the study has nothing to draw in it yet.
        """
        from gtf_tune.report.build import read_input
        from gtf_tune.report.definition import ReportDefinition
        from gtf_tune.report.panels import registry
        from gtf_tune.report.panels.base import Drawing

        if panel not in registry.KINDS:
            raise DefinitionError(f"there is no panel '{panel}'; panels are {', '.join(registry.KINDS)}")
        blocks = registry.panel(panel).blocks(read_input(self._database, self.name, ReportDefinition()))
        drawings = [block for block in blocks if isinstance(block, Drawing)]
        chosen = [drawing for drawing in drawings if figure in f"{drawing.name} {drawing.title}"]
        if not chosen:
            names = ", ".join(f"'{drawing.name}'" for drawing in drawings) or "none so far"
            raise DefinitionError(f"panel '{panel}' of study '{self.name}' has the figures {names}")
        return chosen[0].figure

    @property
    def optuna(self) -> "optuna.Study":
        """The same study as Optuna knows it, for reading; its trials are chosen, run and scored by `run` alone."""
        with quiet_optuna():
            return optuna.load_study(study_name=self.name, storage=optuna_storage(self._database))

    @property
    def is_confirmed(self) -> bool:
        """Whether a confirmation has compared nominal with the best trial so far."""
        evidence = recommend(self._database, studies.get(self._database, self.name)).evidence
        return evidence.confirmation is not None and evidence.newer is None

    def _set_budget(self, total: int) -> None:
        record = studies.get(self._database, self.name)
        known = sum(trials.counts(self._database, record.id).values())
        wanted = max(total, known, 1)
        if wanted != defined_budget(stored_definition(record)) + len(numbers_of(record.resolved)):
            extend_study(self._database, self.name, Extension(trials=wanted, may_shrink=True))

    def _open(self) -> OpenStudy:
        """Return the study ready for work; opened again only where it changed, since that reads all images."""
        record = studies.get(self._database, self.name)
        if self._opened is None or self._opened.record != record:
            with quiet_optuna():
                self._opened = open_study(
                    self._database,
                    self.name,
                    pipeline=self._access.pipeline,
                    allow_version_mismatch=self._access.allow_version_mismatch,
                )
        return self._opened


@dataclass(frozen=True)
class Access:
    """How a study is opened for work: with a pipeline that its name alone does not make, by any version of it."""

    pipeline: Pipeline | None = None
    allow_version_mismatch: bool = False


@contextlib.contextmanager
def quiet_optuna() -> Iterator[None]:
    """Let Optuna log warnings only for the length of a context."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(max(before, optuna.logging.WARNING))
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


@contextlib.contextmanager
def _interruptible() -> Iterator[StopRequest]:
    """Turn Ctrl-C into a stop request for the length of a context; only a main thread hears of it."""
    stop = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    with signals_to(stop, _log.warning):
        yield stop


def _logged(study: OpenStudy) -> Callback:
    """Return what logs trials, failed runs and the choice of noise."""
    unit = definition_unit(study.definition)

    def log(event: Event) -> None:
        text = summary(event, unit)
        if text:
            _log.info("study '%s': %s", study.definition.name, text)

    return log
