"""Extend a study."""

from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, hush_optuna, open_storage, storage_flag
from gtf_tune.cli.study.create import Range, parse_range
from gtf_tune.cli.terminal.console import say
from gtf_tune.cli.values import split_pairs

if TYPE_CHECKING:
    from gtf_tune.store.studies import Study

Trials = Annotated[
    int | None, typer.Option("--trials", "-n", min=1, max=10**7, help="New total of trials, nominal included.")
]
NoisyRuns = Annotated[
    int | None, typer.Option("--noisy-runs", "-K", min=1, max=1000, help="Another k_delta; needs --as.")
]
NewName = Annotated[str | None, typer.Option("--as", help="Make a new study on the same runs instead.")]


def extend(
    name: StudyName,
    trials: Trials = None,
    noisy_runs: NoisyRuns = None,
    range_: Range = None,
    new_name: NewName = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Give a study more trials or wider ranges; changes that make trials incomparable need a new name.

    A new study under --as takes over every run that is the same, so nothing is computed twice.

    Example: gtf-tune study extend photos --trials 80
    """
    from gtf_tune.study.edit import Extension, derive_study, extend_study
    from gtf_tune.study.open_study import trials_left

    hush_optuna()
    database = open_storage(storage)
    axes = {option: parse_range(option, bounds) for option, bounds in split_pairs(range_, "--range").items()}
    extension = Extension(trials, noisy_runs, axes)
    if new_name is None:
        extended = extend_study(database, name, extension)
        say(f"extended study '{name}'; workers that are at it now notice when they are started again")
        if not trials_left(database, extended):
            _say_nothing_is_left(extended, bool(axes), storage_flag(database))
            return
        if extended.state != "open":
            say(f"it stays {extended.state} until it is resumed")
            say(f"Next: gtf-tune study resume {name}{storage_flag(database)}")
            return
    else:
        derive_study(database, name, extension, new_name)
        say(f"created study '{new_name}' on the runs of '{name}'")
    say(f"Next: gtf-tune study run {new_name or name}{storage_flag(database)}")


def enqueue(
    name: StudyName,
    option: Annotated[
        list[str],
        typer.Option(
            "--option",
            "-o",
            metavar="OPTION=VALUE|FILE.json",
            help="An option of the trial; the others have their nominal values.",
        ),
    ],
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Add a trial with options that you give, such as a colleague's; the number of trials rises by one.

    Workers run it before they go on with the search, whose own trials stay the same.

    Example: gtf-tune study enqueue photos -o mapper.max_normalized_reproj_error=2e-3
    """
    from gtf_tune.cli.values import parse_options
    from gtf_tune.store import studies
    from gtf_tune.study.enqueue import enqueue as enqueue_options

    hush_optuna()
    database = open_storage(storage)
    number = enqueue_options(database, name, parse_options(option, "--option"))
    say(f"trial {number} of study '{name}' will have these options")
    state = studies.get(database, name).state
    say(f"Next: gtf-tune study {'run' if state == 'open' else 'resume'} {name}{storage_flag(database)}")


def _say_nothing_is_left(study: "Study", has_wider_range: bool, flag: str) -> None:
    """Print why an extended study has no trial to do, and how to give it some."""
    from gtf_tune.store.studies import stored_definition

    if stored_definition(study).search.sampler == "grid":
        say("every point of its grid has its trial already; a new study on the same runs may have more of them")
        say(f"Next: gtf-tune study extend {study.name} --as NEW-NAME --range NAME=LOW:HIGH{flag}")
        return
    new = "nothing searches the new range yet" if has_wider_range else "it has nothing to do yet"
    say(f"all of its trials are done, so {new}; give it more trials")
    say(f"Next: gtf-tune study extend {study.name} --trials N{flag}")
