"""Warn of what makes the outcome of a study doubtful, and suggest the next command."""

import shutil
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from gtf_tune.cli.parameters import storage_flag
from gtf_tune.cli.terminal.console import duration, say

if TYPE_CHECKING:
    from gtf_tune.store.database import Database
    from gtf_tune.store.studies import Study
    from gtf_tune.study.open_study import OpenStudy
    from gtf_tune.study.outcome.recommendation import Recommendation

STOPPED_EARLY = "* stopped early, on fewer noisy runs than the others: never recommended"
_GOOD_COVERAGE = 0.9


def warn_of_lost_frames(database: "Database", study_id: int) -> None:
    """Say on stderr on which sequences the nominal options lose frames, without noise or because of it."""
    from gtf_tune.store import trials
    from gtf_tune.study.outcome.evidence import frames_lost_to_noise

    nominal = trials.nominal(database, study_id)
    if nominal is None or nominal.state != "complete":
        return
    for name, found in trials.details(database, [nominal.id])[nominal.id]["sequences"].items():
        clean = found["coverage_nominal"]
        if clean == 0:
            say(f"warning: on {name} the nominal options give no trajectory: {nominal.message}")
        elif clean < _GOOD_COVERAGE:
            say(
                f"warning: on {name} the nominal options register only {clean:.0%} of the frames; look at 'gtf-tune "
                "sequence inspect', and give the intrinsics if they are known"
            )
        lost = frames_lost_to_noise(found)
        if lost:
            say(
                f"warning: on {name} {lost}, so the score says little; find a weaker noise with 'gtf-tune noise', and "
                "create a new study with --noise-sigma"
            )


def say_what_is_ahead(study: "OpenStudy", runs_ahead: int, jobs: int) -> None:
    """Say on stderr how many runs are to be made, and how long they take by those of the study so far."""
    from gtf_tune.display import count
    from gtf_tune.store import runs

    cost = runs.totals(study.database, study.record.id)
    for sentence in _option_costs(study) if runs_ahead else ():
        say(sentence)
    if not cost.made:
        say(f"{count(runs_ahead, 'run')} to make; how long they take is known after the first trial")
        return
    seconds = runs_ahead * cost.made_s / cost.made / jobs
    say(f"{count(runs_ahead, 'run')} to make, about {duration(seconds)} ({jobs} at a time)")


def say_disk(cache_dir: Path | None) -> None:
    """Say on stderr where stages of runs are kept, how much room they may take, and how much there is."""
    from gtf_tune.execution import StageCache, private_cache_folder

    cache = StageCache(private_cache_folder(cache_dir))
    limit, free = cache.limit_bytes / 2**30, shutil.disk_usage(cache.folder).free / 2**30
    say(f"disk: at most {limit:.0f} GiB for stages of runs in {cache.folder}, where {free:.0f} GiB are free")


def _option_costs(study: "OpenStudy") -> list[str]:
    """Return what searched options cost that repeat more than mapping, by the times of nominal's runs so far."""
    from gtf_tune.store import runs, trials
    from gtf_tune.study.runs.plan import STAGES, option_costs

    nominal = trials.nominal(study.database, study.record.id)
    said = [use.run.diagnostics for use in runs.of_trial(study.database, nominal.id)] if nominal else []
    longest = {stage: max((float(times.get(f"{stage}_s", 0.0)) for times in said), default=0.0) for stage in STAGES}
    return option_costs({name: study.pipeline.options.specs[name].stage for name in study.definition.space}, longest)


def runs_of_search(study: "OpenStudy") -> int:
    """Return how many runs the trials that are left need at the most."""
    from gtf_tune.store import trials
    from gtf_tune.study.runs.plan import kept_runs

    counts = trials.counts(study.database, study.record.id)
    ended = sum(number for state, number in counts.items() if state != "claimed")
    gtf = study.definition.gtf
    each = (gtf.clean_runs + gtf.noisy_runs_max) * len(study.sequences)
    return max((study.budget - ended) * each - kept_runs(study.database, study.record).stored, 0)


def warn_of_mixed_versions(database: "Database", study_id: int, numbers: Collection[int]) -> None:
    """Say on stderr which of some trials were made by another version of the pipeline than nominal."""
    from gtf_tune.store import trials

    found = trials.version_mismatches(database, study_id, {0, *numbers})
    for number in sorted(set(numbers) - {0}):
        if found.get(number) != found.get(0):
            notes = [
                f"the worker of trial {trial} noted that the study {found[trial]}"
                for trial in (0, number)
                if trial in found
            ]
            say(
                f"warning: nominal and trial {number} were made by different versions of the pipeline, which may be "
                f"what sets them apart; {' and '.join(notes)}"
            )


def suggest_export(database: "Database", name: str, pipeline: str) -> None:
    """Say on stderr how to write the options to use in the form that users of the pipeline paste."""
    from gtf_tune.study.outcome.export import formats_of

    say(f"Next: gtf-tune study export {name} --format {formats_of(pipeline)[0]}{storage_flag(database)}")


def suggest_step(found: "Recommendation", database: "Database", study: "Study") -> None:
    """Say on stderr what to do with a recommendation."""
    from gtf_tune.store.studies import stored_definition

    name, flag = study.name, storage_flag(database)
    if found.step == "export":
        suggest_export(database, name, stored_definition(study).pipeline.name)
    elif found.step == "confirm":
        say(f"Next: gtf-tune study confirm {name}{flag}")
    elif found.step == "new study":
        say(f"create a study whose nominal options (--option) work. Next: gtf-tune study report {name}{flag}")
    elif found.step == "other noise":
        say(
            "create a study with a weaker noise (--noise-sigma; 'gtf-tune noise' finds one) or with nominal options "
            f"that work. Next: gtf-tune study report {name}{flag}"
        )
    elif found.step == "extend":
        say(f"Next: gtf-tune study extend {name} --trials N{flag}")
    else:
        # The report shows the logs of failed runs.
        command = {"done": "report", "paused": "resume", "stopped": "resume"}.get(study.state, "run")
        say(f"Next: gtf-tune study {command} {name}{flag}")


def suggest_outcome(database: "Database", name: str) -> None:
    """Say on stderr how to see which trial to use, or, where no trial is feasible, what became of the trials."""
    from gtf_tune.store import studies, trials

    found = trials.best(database, studies.get(database, name).id)
    say(f"Next: gtf-tune study {'show' if found is None else 'best'} {name}{storage_flag(database)}")


def suggest_after_show(database: "Database", study: "Study", found: "Recommendation") -> None:
    """Say on stderr what to do with a study whose trials are known."""
    if found.step == "wait":
        suggest_step(found, database, study)
    else:
        say(f"Next: gtf-tune study best {study.name}{storage_flag(database)}")
