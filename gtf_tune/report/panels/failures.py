"""What went wrong, grouped by reason."""

from dataclasses import dataclass

from gtf_tune.display import count
from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.points import sequence_detail, state_of
from gtf_tune.report.study_data import StudyData, runs_made

_NO_REASON = "no reason was stored"
_LISTED_TRIALS = 12


@dataclass(frozen=True)
class RunFailure:
    """One reason why runs failed; ``example_key`` is the key of the first such run, whose log is shown."""

    reason: str
    runs: int
    numbers: tuple[int, ...]
    sequences: tuple[str, ...]
    example: str
    example_key: str


@dataclass(frozen=True)
class TrialFault:
    """One reason why trials have no score, or why some of their pairs of runs have no error."""

    what: str
    reason: str
    count: int
    numbers: tuple[int, ...]


def run_failures(data: StudyData) -> tuple[RunFailure, ...]:
    """Return why runs failed, the most frequent reason first."""
    groups: dict[str, list[tuple[int, str, str, str]]] = {}
    for use in runs_made(data.runs):
        if use.run.status == "failed":
            name = f"{use.run.kind} run {use.run.index} of trial {use.number} on {use.sequence_name}"
            member = (use.number, use.sequence_name, name, use.run.key)
            groups.setdefault(use.run.error or _NO_REASON, []).append(member)
    found = [
        RunFailure(
            reason=reason,
            runs=len(group),
            numbers=tuple(sorted({member[0] for member in group})),
            sequences=tuple(sorted({member[1] for member in group})),
            example=group[0][2],
            example_key=group[0][3],
        )
        for reason, group in groups.items()
    ]
    return tuple(sorted(found, key=lambda failure: -failure.runs))


def trial_faults(data: StudyData) -> tuple[TrialFault, ...]:
    """Return why trials are infeasible, pruned or failed, and why pairs of runs could not be compared."""
    groups: dict[tuple[str, str], list[int]] = {}
    for trial in data.trials:
        state = state_of(trial)
        if state in ("infeasible", "pruned", "failed"):
            groups.setdefault((f"{state} trials", trial.message or _NO_REASON), []).append(trial.number)
        for sequence in data.sequences:
            for reason in sequence_detail(data, trial.number, sequence.name).pair_errors.values():
                groups.setdefault(("pairs without an error", reason), []).append(trial.number)
    return tuple(_fault(what, reason, numbers) for (what, reason), numbers in groups.items())


def failures_panel(report: ReportInput) -> list[Block]:
    """Return what machines did, why runs failed, with an excerpt of a log each, and why trials have no value."""
    failures, faults = run_failures(report.data), trial_faults(report.data)
    machines = [markup.paragraph(fault.text) for fault in report.data.machine_faults]
    if not failures and not faults:
        nothing = "Nothing failed: every run ended with a trajectory, and every trial is feasible."
        return [*machines, markup.missing(nothing)]
    blocks: list[Block] = [_failure(failure, report) for failure in failures]
    if not failures:
        blocks.append(markup.missing("No run failed."))
    if faults:
        rows = [(fault.what, fault.reason, fault.count, _trial_list(fault.numbers)) for fault in faults]
        blocks.append(markup.table(["what", "reason", ">count", "trials"], rows))
    return [*machines, *blocks]


def _fault(what: str, reason: str, numbers: list[int]) -> TrialFault:
    return TrialFault(what, reason, len(numbers), tuple(sorted(set(numbers))))


def _failure(failure: RunFailure, report: ReportInput) -> Html:
    log = report.logs.get(failure.example_key, "")
    excerpt = "\n".join(log.rstrip().splitlines()[-report.lengths.log_lines :])
    title = f"{count(failure.runs, 'run')}: {failure.reason}"
    where = markup.paragraph(
        f"On {', '.join(failure.sequences)}, {'trial' if len(failure.numbers) == 1 else 'trials'} "
        f"{_trial_list(failure.numbers)}; the end of the log of {failure.example}:"
    )
    shown = markup.element("pre", markup.text(excerpt)) if excerpt else markup.missing("The run printed nothing.")
    return markup.element("details", markup.element("summary", markup.text(title)), where, shown, open="")


def _trial_list(numbers: tuple[int, ...]) -> str:
    shown = ", ".join(str(number) for number in numbers[:_LISTED_TRIALS])
    return shown + (f" and {len(numbers) - _LISTED_TRIALS} more" if len(numbers) > _LISTED_TRIALS else "")


PANEL = Panel("Failures", failures_panel)
