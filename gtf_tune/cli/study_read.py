"""List and show studies, and delete them."""

import json as json_module
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.console import (
    duration,
    number,
    percent,
    permille,
    say,
    write_json,
    write_line,
    write_pairs,
    write_table,
)
from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName
from gtf_tune.cli.storage_access import open_storage

if TYPE_CHECKING:
    from gtf_tune.store.trials import Trial
    from gtf_tune.study.picking import Pick

All = Annotated[bool, typer.Option("--all", help="Every trial, not only the best twenty and nominal.")]
_SHOWN_TRIALS = 20


def list_studies(json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """List the studies of a storage.

    Example: gtf-tune study list
    """
    from gtf_tune.store import studies

    summaries = studies.summaries(open_storage(storage))
    if json:
        write_json([vars(one) for one in summaries])
        return
    rows = [
        (
            one.name,
            one.state,
            f"{one.complete}/{one.trials}",
            permille(one.nominal_value),
            permille(one.best_value),
            duration(one.wall_s),
        )
        for one in summaries
    ]
    write_table(["study", "state", ">trials", ">nominal", ">best", ">time"], rows)
    say("scores in per mille of the extent")
    if summaries:
        say(f"Next: gtf-tune study show {summaries[-1].name}")


def show(name: StudyName, all_: All = False, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Show a study: what is tuned, on what, and every trial.

    Example: gtf-tune study show photos
    """
    from gtf_tune.store import studies, trials, validations

    database = open_storage(storage)
    study = studies.get(database, name)
    known = trials.of_study(database, study.id)
    truth = validations.of_study(database, study.id)
    gt_ates = {ordinal: found[0].ate for ordinal, found in truth.items() if len(found) == 1}
    if json:
        definition = json_module.loads(study.definition)
        shown = [{**vars(trial), "gt_ate": gt_ates.get(trial.ordinal)} for trial in known]
        write_json({"name": study.name, "state": study.state, "definition": definition, "trials": shown})
        return
    _write_heading(study.definition, study.state, known)
    ranked = sorted(known, key=_rank)
    chosen = ranked if all_ else [one for one in ranked if one.ordinal == 0 or one in ranked[:_SHOWN_TRIALS]]
    _write_trials(chosen, gt_ates)
    if len(chosen) < len(known):
        say(f"{len(known) - len(chosen)} more trials with --all")
    say(f"Next: gtf-tune study best {name}")


def best(name: StudyName, json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Print the nominal and the best setting, what the best is worth, and its options to paste.

    Example: gtf-tune study best photos
    """
    from gtf_tune.errors import StorageError
    from gtf_tune.store import studies
    from gtf_tune.study.picking import pick

    database = open_storage(storage)
    study = studies.get(database, name)
    found = pick(database, study.id)
    if found.best is None:
        raise StorageError(f"study '{name}' has no feasible trial yet; run it with: gtf-tune study run {name}")
    definition = json_module.loads(study.definition)
    if json:
        write_json(_pick_as_json(found))
        return
    _write_pick(found, definition)
    say("unconfirmed: the best of many trials looks better than it is")
    say(f"Next: gtf-tune study export {name} --format colmap-ini")


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


def _rank(trial: "Trial") -> tuple[bool, float, int]:
    return (not trial.feasible, trial.value if trial.value is not None else float("inf"), trial.ordinal)


def _write_heading(definition_json: str, state: str, known: list["Trial"]) -> None:
    definition = json_module.loads(definition_json)
    gtf = definition["gtf"]
    sequences = ", ".join(one["name"] for one in definition["sequences"])
    finished = sum(trial.state != "claimed" for trial in known)
    write_pairs(
        {
            "study": f"{definition['name']} ({state}, {finished} trials done)",
            "pipeline": definition["pipeline"]["name"],
            "sequences": sequences,
            "runs a trial": f"{gtf['clean_runs']} clean, {gtf['noisy_runs']} noisy at {gtf['noise_sigma']} grey levels",
            "score": f"{gtf['metric']}, {gtf['aggregate']}, {gtf['alignment']}, normalised by {gtf['normalise']}",
            "sampler": f"{definition['search']['sampler']}, seed {definition['search']['seed']}",
        }
    )
    write_line("")


def _write_trials(chosen: list["Trial"], gt_ates: Mapping[int, float | None]) -> None:
    columns = [">trial", ">GTF ATE [‰]", ">± se", ">coverage", "options"]
    if gt_ates:
        columns.insert(3, ">true ATE")
    rows = []
    for trial in chosen:
        score = permille(trial.value) if trial.feasible else trial.state if trial.value is None else "infeasible"
        row = [str(trial.ordinal), score, permille(trial.standard_error), _share(trial.coverage), _options(trial)]
        if gt_ates:
            row.insert(3, number(gt_ates.get(trial.ordinal)))
        rows.append(row)
    write_table(columns, rows)


def _write_pick(found: "Pick", definition: Mapping[str, Any]) -> None:
    best_trial = found.best
    if best_trial is None:
        return
    pairs = {}
    if found.nominal is not None:
        pairs["nominal"] = f"GTF ATE {permille(found.nominal.value)} ‰ of the extent"
    pairs["best"] = f"GTF ATE {permille(best_trial.value)} ‰ (trial {best_trial.ordinal})"
    gain = found.improvement
    if found.is_nominal:
        pairs["improvement"] = "none: nothing beats the nominal setting"
    elif gain is not None:
        bounds = f"95 % interval {percent(-gain.high)} to {percent(-gain.low)}"
        pairs["change"] = f"{percent(-gain.value)} ({bounds}, {gain.instances} noisy runs, paired)"
    write_pairs(pairs)
    write_line("")
    for name, value in {**definition["pipeline"]["options"], **(best_trial.options or {})}.items():
        write_line(f"{name} = {value}")


def _pick_as_json(found: "Pick") -> dict[str, Any]:
    return {
        "nominal": vars(found.nominal) if found.nominal else None,
        "best": vars(found.best) if found.best else None,
        "improvement": vars(found.improvement) if found.improvement else None,
        "verdict": "unconfirmed",
    }


def _options(trial: "Trial") -> str:
    pairs = (trial.options or {}).items()
    text = ", ".join(
        f"{name.rsplit('.', 1)[-1]}={value:.4g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in pairs
    )
    return f"{text} (nominal)" if trial.ordinal == 0 else text


def _share(coverage: float | None) -> str:
    return "-" if coverage is None else f"{coverage:.0%}"
