"""List and show studies, and delete them."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName
from gtf_tune.cli.storage_access import open_storage, storage_flag
from gtf_tune.cli.study.notes import (
    STOPPED_EARLY,
    suggest_after_show,
    suggest_export,
    suggest_nominal_that_works,
    suggest_working_nominal,
    warn_of_lost_frames,
    warn_of_mixed_versions,
)
from gtf_tune.cli.terminal.console import (
    duration,
    percent,
    say,
    write_json,
    write_line,
    write_options,
    write_pairs,
    write_table,
)
from gtf_tune.cli.true_errors import TrueErrors

if TYPE_CHECKING:
    from gtf_tune.definition import StudyDefinition
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.runs import RunTotals
    from gtf_tune.store.studies import Study
    from gtf_tune.store.trials import Effort, Trial
    from gtf_tune.study.outcome.improvement import Pick
    from gtf_tune.study.outcome.recommendation import Recommendation

All = Annotated[bool, typer.Option("--all", help="Every trial, not only the best twenty and nominal.")]
_SHOWN_TRIALS = 20
_OPTION_COLUMNS = 2


def list_studies(json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """List the studies of a storage.

    Example: gtf-tune study list
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition

    database = open_storage(storage)
    summaries = studies.summaries(database)
    if json:
        write_json([{key: value for key, value in vars(one).items() if key != "definition"} for one in summaries])
        return
    units = [definition_unit(stored_definition(one)) for one in summaries]
    rows = [
        (
            one.name,
            one.state,
            f"{one.done}/{one.trials}",
            unit.text(one.nominal_value),
            unit.text(one.best_value),
            unit.symbol,
            duration(one.wall_s),
        )
        for one, unit in zip(summaries, units, strict=True)
    ]
    if not rows:
        say("no study yet; make one with: gtf-tune study create --help")
        return
    write_table(["study", "state", ">done/begun", ">nominal", ">best", "unit", ">time"], rows)
    say(f"Next: gtf-tune study show {summaries[-1].name}{storage_flag(database)}")


def show(name: StudyName, all_: All = False, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Show a study: what is tuned, on what, and every trial.

    Example: gtf-tune study show photos
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import ground_truth_errors, runs, studies, trials
    from gtf_tune.store.studies import stored_definition

    database = open_storage(storage)
    study = studies.get(database, name)
    definition = stored_definition(study)
    truth = TrueErrors(definition.side_metric, ground_truth_errors.values(database, study.id))
    if json:
        versions = trials.version_mismatches(database, study.id)
        shown = [
            {**one.as_dict(), "version_mismatch": versions.get(one.number), **truth.as_json(one.number)}
            for one in trials.of_study(database, study.id)
        ]
        write_json(
            {
                "name": study.name,
                "state": study.state,
                "definition": definition.model_dump(mode="json"),
                "side_metric": {"words": truth.side.words, "unit": truth.side.unit},
                "trials": shown,
            }
        )
        return
    efforts = trials.efforts(database, study.id)
    _write_heading(definition, study, efforts, runs.totals(database, study.id))
    if truth.by_trial:
        say(f"ground truth, never seen by the search: {truth.side.words} [{truth.side.unit}]")
    count = sum(one.count for one in efforts)
    chosen = trials.ranked(database, study.id, count if all_ else _SHOWN_TRIALS)
    nominal = trials.nominal(database, study.id)
    if nominal is not None and nominal.number not in [one.number for one in chosen]:
        chosen.append(nominal)
    _write_trials(chosen, truth, definition_unit(definition), trials.option_names(database, study.id))
    if len(chosen) < count:
        say(f"{count - len(chosen)} more trials with --all")
    warn_of_lost_frames(database, study.id)
    suggest_after_show(database, study)


def best(name: StudyName, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Print the nominal and the best setting, the verdict of the last confirmation, and the options to use.

    Example: gtf-tune study best photos
    """
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.improvement import pick
    from gtf_tune.study.outcome.recommendation import UNCONFIRMED, recommend

    database = open_storage(storage)
    study = studies.get(database, name)
    recommended = recommend(database, study.id, name)
    found = pick(database, study.id)
    if json:
        write_json(_pick_as_json(found, recommended))
        return
    definition = stored_definition(study)
    _write_pick(found, recommended, definition)
    picks = [one for one in (recommended.trial, found.best) if one is not None]
    warn_of_mixed_versions(database, study.id, [one.number for one in picks])
    warn_of_lost_frames(database, study.id)
    if recommended.turned_down:
        suggest_nominal_that_works(name, storage_flag(database))
    elif recommended.verdict == UNCONFIRMED and recommended.confirmation:
        suggest_working_nominal(name, storage_flag(database))
    elif recommended.verdict == UNCONFIRMED:
        say("unconfirmed: the best of many trials looks better than it is")
        say(f"Next: gtf-tune study confirm {name}{storage_flag(database)}")
    else:
        suggest_export(database, name, definition.pipeline.name)


def delete(
    name: StudyName,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Delete a study with its trials, and the runs that no other study uses.

    Example: gtf-tune study delete photos --yes
    """
    from gtf_tune.store import studies

    database = open_storage(storage)
    study = studies.get(database, name)
    if not yes:
        typer.confirm(f"Delete study '{study.name}' with all of its trials and runs?", abort=True, err=True)
    studies.delete_study(database, name)
    say(f"deleted study '{name}'")


def _write_heading(definition: "StudyDefinition", study: "Study", efforts: list["Effort"], cost: "RunTotals") -> None:
    gtf = definition.gtf
    noise = _noise(definition, study)
    finished = sum(one.count for one in efforts if one.state != "claimed")
    spared = _spared(definition, efforts)
    write_pairs(
        {
            "study": f"{definition.name} ({study.state}, {finished} trials done)",
            "pipeline": definition.pipeline.name,
            "sequences": ", ".join(one.name for one in definition.sequences),
            "runs a trial": f"{gtf.clean_runs} clean, {gtf.noisy_runs_text} noisy {noise}",
            "score": gtf.score_text,
            "sampler": f"{definition.search.sampler}, seed {definition.search.seed}",
            "runs": f"{cost.made} made in {duration(cost.made_s)}, {cost.reused} reused, {cost.failed} failed",
            **({"spared": spared} if spared else {}),
        }
    )
    write_line("")


def _noise(definition: "StudyDefinition", study: "Study") -> str:
    """Return in words the noise of the search, of each sequence where it was measured and differs."""
    known = study.resolved["noise_sigma"]
    found = {one.name: known[one.name] for one in definition.searched_sequences if one.name in known}
    if len(set(found.values())) > 1:
        return f"at {', '.join(f'{sigma:g} ({name})' for name, sigma in found.items())} grey levels"
    return next((f"at {sigma:g} grey levels" for sigma in found.values()), "(the noise is measured first)")


def _spared(definition: "StudyDefinition", efforts: list["Effort"]) -> str:
    """Return what stopping early has saved; nothing before a trial has ended."""
    from gtf_tune.study.scoring.savings import runs_saved

    saved = runs_saved(efforts, definition)
    if not saved.full:
        return ""
    ways = {"sizing": saved.by_sizing, "the pruner": saved.by_pruner, "infeasible trials": saved.by_coverage}
    told = ", ".join(f"{count} by {way}" for way, count in ways.items() if count)
    return f"{told} ({saved.share:.0%} of {saved.full} runs)" if told else "no run: every trial took all of its runs"


def _write_trials(chosen: list["Trial"], truth: TrueErrors, unit: "ScoreUnit", names: list[str]) -> None:
    fragile = any(trial.collapsed_rate for trial in chosen)  # the column costs width, and is 0 % in most studies
    columns = [">trial", f">{unit.name} [{unit.short}]", ">± se", *truth.columns, ">coverage"]
    columns += [">collapsed"] if fragile else []
    columns += [f">{name}" for name in _short_names(names)] if len(names) <= _OPTION_COLUMNS else ["options"]
    rows = []
    for trial in chosen:
        row = [_name(trial), _score(trial, unit), unit.text(trial.standard_error)]
        row += truth.cells(trial.number)
        row += [_share(trial.coverage), *([_share(trial.collapsed_rate)] if fragile else [])]
        values = [_value((trial.options or {}).get(name)) for name in names]
        pairs = zip(_short_names(names), values, strict=True)
        row += values if len(names) <= _OPTION_COLUMNS else [", ".join(f"{name}={value}" for name, value in pairs)]
        rows.append(row)
    write_table(columns, rows)
    if any(trial.state == "pruned" for trial in chosen):
        write_line(STOPPED_EARLY)


def _short_names(names: list[str]) -> list[str]:
    """Return the last part of each dotted path, or the whole path where that says too little."""
    last = [name.rsplit(".", 1)[-1] for name in names]
    return [short if last.count(short) == 1 else name for short, name in zip(last, names, strict=True)]


def _name(trial: "Trial") -> str:
    return "nominal" if trial.number == 0 else str(trial.number)


def _score(trial: "Trial", unit: "ScoreUnit") -> str:
    if trial.value is None:
        return trial.state
    if not trial.feasible:
        return "infeasible"
    return unit.text(trial.value) + ("*" if trial.state == "pruned" else "")


def _value(value: object) -> str:
    from gtf_tune.pipelines.options import option_text

    return "-" if value is None else option_text(value, digits=4)


def _write_pick(found: "Pick", recommended: "Recommendation", definition: "StudyDefinition") -> None:
    from gtf_tune.display import definition_unit

    unit = definition_unit(definition)
    symbol = unit.short
    pairs = {}
    if found.nominal is not None and found.nominal.feasible:
        pairs["nominal"] = (
            f"{unit.name} {unit.text(found.nominal.value)} {symbol}{' of the extent' if symbol == '‰' else ''}"
        )
    elif found.nominal is not None:
        pairs["nominal"] = f"infeasible: {found.nominal.message}"
    if found.best is not None:
        pairs["best"] = f"{unit.name} {unit.text(found.best.value)} {symbol} (trial {found.best.number})"
    gain = found.improvement
    if found.is_nominal:
        pairs["improvement"] = "none: nothing beats the nominal setting"
    elif gain is not None and gain.instances > 1:
        bounds = f"95 % interval {percent(-gain.high)} to {percent(-gain.low)}"
        pairs["change"] = f"{percent(-gain.value)} ({bounds}, {gain.instances} noisy runs, paired)"
    elif gain is not None and gain.instances:
        pairs["change"] = f"{percent(-gain.value)} (one noisy run: no interval)"
    pairs["verdict"] = _verdict(recommended)
    write_pairs(pairs)
    write_line("")
    write_options({**definition.pipeline.options, **(recommended.trial.options or {})})


def _verdict(recommended: "Recommendation") -> str:
    found = recommended.candidate
    if not found or found["improvement"] is None:
        return recommended.verdict
    bounds = f"95 % interval {percent(-found['high'])} to {percent(-found['low'])}"
    change = f"{percent(-found['improvement'])} on fresh noise ({bounds}, {found['instances']} noisy runs)"
    word = (
        f"{recommended.verdict} trial {recommended.trial.number}" if recommended.trial.number else recommended.verdict
    )
    against = "".join(f"; {reason}" for reason in found["reasons"])
    return f"{word}; trial {found['ordinal']}: {change}{against}"


def _pick_as_json(found: "Pick", recommended: "Recommendation") -> dict[str, Any]:
    return {
        "nominal": found.nominal.as_dict() if found.nominal else None,
        "best": found.best.as_dict() if found.best else None,
        "improvement": vars(found.improvement) if found.improvement else None,
        "verdict": recommended.verdict,
        "recommended": recommended.trial.as_dict(),
        "confirmation": recommended.confirmation or None,
    }


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"
