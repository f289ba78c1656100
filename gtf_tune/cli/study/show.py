"""Show a study and its trials."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName, open_storage
from gtf_tune.cli.study.notes import STOPPED_EARLY, suggest_after_show, warn_of_lost_frames
from gtf_tune.cli.study.true_errors import TrueErrors
from gtf_tune.cli.terminal.console import duration, say, write_json, write_line, write_pairs, write_table

if TYPE_CHECKING:
    from gtf_tune.definition import StudyDefinition
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.database import Database
    from gtf_tune.store.runs import RunTotals
    from gtf_tune.store.studies import Study
    from gtf_tune.store.trials import Effort, Trial
    from gtf_tune.study.outcome.recommendation import Recommendation

All = Annotated[bool, typer.Option("--all", help="Every trial, not only the best twenty and nominal.")]
_SHOWN_TRIALS = 20
_SHOWN_FAULTS = 3
_OPTION_COLUMNS = 2


def show(name: StudyName, all_: All = False, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Show a study: what is tuned, on what, its trials, and which of them to use.

    Example: gtf-tune study show photos
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import ground_truth_errors, runs, studies, trials
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.recommendation import recommend
    from gtf_tune.study.runs.plan import kept_runs

    database = open_storage(storage)
    study = studies.get(database, name)
    definition = stored_definition(study)
    truth = TrueErrors(definition.side_metric, ground_truth_errors.values(database, study.id))
    found = recommend(database, study)
    if json:
        write_json(_as_json(database, study, truth, found))
        return
    efforts = trials.efforts(database, study.id)
    _write_heading(definition, study, efforts, runs.totals(database, study.id), kept_runs(database, study).text)
    if truth.by_trial:
        say(f"ground truth, never seen by the search: {truth.side.words} [{truth.side.unit}]")
    count = sum(effort.count for effort in efforts)
    chosen = _with(trials.ranked(database, study.id, count if all_ else _SHOWN_TRIALS), found)
    names = trials.option_names(database, study.id)
    _write_trials(chosen, truth, definition_unit(definition), names, _number(found.trial))
    if count:
        write_line("")
        write_pairs({">" if found.trial else "verdict": found.text})
    if len(chosen) < count:
        say(f"{count - len(chosen)} more trials with --all")
    for fault in runs.machine_faults(database, study.id)[:_SHOWN_FAULTS]:
        say(f"note: {fault.text}")
    warn_of_lost_frames(database, study.id)
    suggest_after_show(database, study, found)


def _as_json(database: "Database", study: "Study", truth: TrueErrors, found: "Recommendation") -> dict[str, Any]:
    from gtf_tune.store import runs, trials
    from gtf_tune.store.studies import stored_definition

    versions = trials.version_mismatches(database, study.id)
    faults = [vars(fault) for fault in runs.machine_faults(database, study.id)]
    return {
        "name": study.name,
        "state": study.state,
        "definition": stored_definition(study).model_dump(mode="json"),
        "side_metric": {"words": truth.side.words, "unit": truth.side.unit},
        "trials": [
            {**trial.as_dict(), "version_mismatch": versions.get(trial.number), **truth.as_json(trial.number)}
            for trial in trials.of_study(database, study.id)
        ],
        "machine_faults": faults,
        "recommendation": found.summary(),
    }


def _with(shown: list["Trial"], found: "Recommendation") -> list["Trial"]:
    """Return the trials to show, the one to use and nominal among them in any case."""
    more = [trial for trial in (found.trial, found.evidence.nominal) if trial is not None]
    return list({trial.number: trial for trial in [*shown, *more]}.values())


def _number(trial: "Trial | None") -> int | None:
    return None if trial is None else trial.number


def _write_heading(
    definition: "StudyDefinition", study: "Study", efforts: list["Effort"], cost: "RunTotals", kept: str
) -> None:
    from gtf_tune.display import nominal_text

    gtf = definition.gtf
    noise = _noise(definition, study)
    finished = sum(effort.count for effort in efforts if effort.state != "claimed")
    write_pairs(
        {
            "study": f"{definition.name} ({study.state}, {finished} trials done)",
            "pipeline": definition.pipeline.name,
            **({"nominal": nominal_text(definition)} if definition.pipeline.nominal else {}),
            "sequences": ", ".join(sequence.name for sequence in definition.sequences),
            "runs a trial": f"{gtf.clean_runs} clean, {gtf.noisy_runs_text} noisy {noise}",
            "score": gtf.score_text,
            "sampler": f"{definition.search.sampler}, seed {definition.search.seed}",
            "runs": f"{cost.made} made in {duration(cost.made_s)}, {cost.reused} reused, {cost.failed} failed",
            **({"under way": kept} if kept else {}),
        }
    )
    write_line("")


def _noise(definition: "StudyDefinition", study: "Study") -> str:
    """Return the noise of the search in words, for each sequence where it was measured and differs."""
    known = study.resolved["noise_sigma"]
    found = {
        sequence.name: known[sequence.name] for sequence in definition.searched_sequences if sequence.name in known
    }
    if len(set(found.values())) > 1:
        return f"at {', '.join(f'{sigma:g} ({name})' for name, sigma in found.items())} grey levels"
    return next((f"at {sigma:g} grey levels" for sigma in found.values()), "(the noise is measured first)")


def _write_trials(
    chosen: list["Trial"], truth: TrueErrors, unit: "ScoreUnit", names: list[str], recommended: int | None
) -> None:
    from gtf_tune.display import short_names

    fragile = any(trial.collapsed_rate for trial in chosen)  # the column costs width, and is 0 % in most studies
    columns = [">trial", f">{unit.name} [{unit.short}]", ">± se", *truth.columns, ">coverage"]
    columns += [">collapsed"] if fragile else []
    columns += [f">{name}" for name in short_names(names)] if len(names) <= _OPTION_COLUMNS else ["options"]
    rows = []
    for trial in chosen:
        row = [_name(trial, recommended), _score(trial, unit), unit.text(trial.standard_error)]
        row += truth.cells(trial.number)
        row += [_share(trial.coverage), *([_share(trial.collapsed_rate)] if fragile else [])]
        values = [_value((trial.options or {}).get(name)) for name in names]
        pairs = zip(short_names(names), values, strict=True)
        row += values if len(names) <= _OPTION_COLUMNS else [", ".join(f"{name}={value}" for name, value in pairs)]
        rows.append(row)
    write_table(columns, rows)
    if any(trial.state == "pruned" for trial in chosen):
        write_line(STOPPED_EARLY)


def _name(trial: "Trial", recommended: int | None) -> str:
    name = "nominal" if trial.number == 0 else str(trial.number)
    return f"> {name}" if trial.number == recommended else name


def _score(trial: "Trial", unit: "ScoreUnit") -> str:
    if trial.value is None:
        return trial.unfinished or trial.state
    if not trial.feasible:
        return "infeasible"
    return unit.text(trial.value) + ("*" if trial.state == "pruned" else "")


def _value(value: object) -> str:
    from gtf_tune.pipelines.options import option_text

    return "-" if value is None else option_text(value, digits=4)


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"
