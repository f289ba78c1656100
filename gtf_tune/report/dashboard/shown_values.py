"""Values as optuna-dashboard shows them: scores in the unit of the report, the recommended trial as the best one."""

import copy
from collections.abc import Container
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from optuna.storages import RDBStorage
from optuna.trial import FrozenTrial, TrialState

from gtf_tune.display import ScoreUnit, definition_unit
from gtf_tune.errors import GtfTuneError
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.trials import study_id_of
from gtf_tune.study.outcome.recommendation import recommend

_DIGITS = 6
_METRIC_NAMES = "study:metric_names"
_SCORES = ("gtf_ate", "gtf_se")


def show_values(storage: RDBStorage, database: Database) -> RDBStorage:
    """Let a storage return what a reader of optuna-dashboard should see, and return it; what is stored stays as it is.

    Values, intermediate values and the attributes that are scores come in the shown unit, such as per mille of the
    extent, and "Best Trial" is the trial that `study best` recommends.
    """
    shown = _ShownValues(database, storage, storage.get_all_trials, storage.get_best_trial, storage.get_all_studies)
    for name in ("get_all_trials", "get_best_trial", "get_all_studies"):
        setattr(storage, name, getattr(shown, name))
    return storage


@dataclass(frozen=True)
class _ShownValues:
    database: Database
    storage: RDBStorage
    all_trials: Any
    best_trial: Any
    all_studies: Any
    known: dict[int, tuple[str, ScoreUnit]] = field(default_factory=dict)

    def get_all_trials(
        self, study_id: int, deepcopy: bool = True, states: Container[TrialState] | None = None
    ) -> list[FrozenTrial]:
        found: list[FrozenTrial] = self.all_trials(study_id, deepcopy, states)
        unit = self._unit(study_id)
        return found if unit is None else [_in_unit(trial, unit) for trial in found]

    def get_best_trial(self, study_id: int) -> FrozenTrial:
        recommended = self._recommended(study_id)
        found: FrozenTrial = self.best_trial(study_id) if recommended is None else self.storage.get_trial(recommended)
        unit = self._unit(study_id)
        return found if unit is None else _in_unit(found, unit)

    def get_all_studies(self) -> list[Any]:
        found: list[Any] = self.all_studies()
        for study in found:
            unit = self._unit(study_id_of(study))
            if unit is not None and _METRIC_NAMES in study.system_attrs:
                study.system_attrs = {**study.system_attrs, _METRIC_NAMES: [unit.label]}
        return found

    def _unit(self, study_id: int) -> ScoreUnit | None:
        """Return the unit of a study's scores; None where it is that of the stored values, or the study is not ours."""
        if study_id not in self.known:
            for name in studies.names(self.database):
                with suppress(GtfTuneError):  # a study that cannot be read is shown as it is stored
                    study = studies.get(self.database, name)
                    self.known[study.optuna_study_id] = name, definition_unit(studies.stored_definition(study))
        _, unit = self.known.get(study_id, ("", None))
        return None if unit is None or unit.factor == 1 else unit

    def _recommended(self, study_id: int) -> int | None:
        self._unit(study_id)
        if study_id not in self.known:
            return None
        with suppress(GtfTuneError):
            trial = recommend(self.database, studies.get(self.database, self.known[study_id][0])).trial
            return None if trial is None else trial.optuna_trial_id
        return None


def _in_unit(trial: FrozenTrial, unit: ScoreUnit) -> FrozenTrial:
    """Return a copy of a trial with its scores in a unit; attributes that are scores get the unit into their names."""
    shown = copy.copy(trial)
    shown.values = [_scaled(value, unit) for value in trial.values] if trial.values else trial.values
    shown.intermediate_values = {step: _scaled(value, unit) for step, value in trial.intermediate_values.items()}
    shown.user_attrs = {
        f"{name} [{unit.symbol}]" if name in _SCORES else name: _scaled(value, unit) if name in _SCORES else value
        for name, value in trial.user_attrs.items()
    }
    return shown


def _scaled(value: float, unit: ScoreUnit) -> float:
    return float(f"{unit.shown(value):.{_DIGITS}g}")
