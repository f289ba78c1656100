"""Print which options of a study to use."""

from typing import TYPE_CHECKING

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName, open_storage
from gtf_tune.cli.study.notes import suggest_step, warn_of_lost_frames, warn_of_mixed_versions
from gtf_tune.cli.terminal.console import write_json, write_line, write_options, write_pairs

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.trials import Trial
    from gtf_tune.study.outcome.recommendation import Recommendation


def best(name: StudyName, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Print which options to use, how sure that is, and why.

    Example: gtf-tune study best photos
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.recommendation import NOTHING_FEASIBLE, recommend, require_trial

    database = open_storage(storage)
    study = studies.get(database, name)
    found = recommend(database, study)
    if found.decision == NOTHING_FEASIBLE:
        require_trial(database, study, found)
    if json:
        write_json(found.as_json())
        return
    definition = stored_definition(study)
    write_pairs(_facts(found, definition_unit(definition)))
    if found.trial is not None:
        write_line("")
        write_options({**definition.fixed_options, **(found.trial.options or {})})
        warn_of_mixed_versions(database, study.id, [found.trial.number])
    warn_of_lost_frames(database, study.id)
    suggest_step(found, database, study)


def _facts(found: "Recommendation", unit: "ScoreUnit") -> dict[str, str]:
    facts = {"verdict": found.headline}
    nominal = found.evidence.nominal
    if nominal is not None and nominal.value is not None:
        facts["nominal"] = _score(nominal, unit) if nominal.feasible else f"infeasible: {nominal.message}"
    if found.trial is not None and found.trial.number > 0:
        facts["best"] = f"{_score(found.trial, unit)} (trial {found.trial.number})"
    facts["why"] = " ".join(found.sentences)
    return facts


def _score(trial: "Trial", unit: "ScoreUnit") -> str:
    symbol = unit.symbol.replace("of extent", "of the extent")
    return f"{unit.name} {unit.text(trial.value)} {symbol} in the search"
