"""Say on half a page whether the paper's result holds here, and what each reason for a difference is worth."""

from collections.abc import Sequence

from experiments.findings import Findings
from experiments.numbers import mean, part, percent, plain
from experiments.paper.numbers import ROWS
from experiments.paper.plan import COLMAPS_HUBER, PAPERS_HUBER
from experiments.plan import AGGREGATE, OPTIONS
from experiments.settings import PREDICTORS, Outcome, Setting
from experiments.weaker import noise_pairs

PAPERS = "mean"
"""The aggregate of the paper."""

_Cell = tuple[Outcome, Setting]


def holds_part(findings: Findings) -> str:
    """Return the section; what was not tested is named as such."""
    cells = [cell for row in ROWS for cell in row.improvements.values()]
    gained, possible = mean(gtf for gtf, _ in cells), mean(truth for _, truth in cells)
    printed = (
        f"In the paper's table {sum(gtf > 0 for gtf, _ in cells)} of {len(cells)} cells improve, by {gained:.0f} % of "
        f"the {possible:.0f} % that ground truth finds."
    )
    here = f"Here, by the paper's {PAPERS}: {_counted(picked(findings.outcomes, PAPERS))}."
    reasons = "\n".join(f"* {line}" for line in [*_tested(findings), _UNTESTED])
    text = f"{printed} {here}{_confirmed(findings.outcomes)} Why they differ, as far as it was tested:\n\n{reasons}"
    columns = ["sequence", *(option.paper_column for option in OPTIONS.values()), "improved"]
    closing = f"Cell by cell, the change of the true ATE at the pick by the {PAPERS} (at the best value):"
    return part("Does it hold?", f"{text}\n\n{closing}", (columns, _rows(findings.outcomes)))


_UNTESTED = (
    "**Frames, colour.** Not tested: without the paper's own images neither its choice of frames nor noise on colour "
    "channels can be compared. `make paper DATA=DIR` takes its frames where they are."
)


def picked(outcomes: Sequence[Outcome], aggregate: str) -> list[_Cell]:
    """Return each grid with the setting that an aggregate picks."""
    return [(outcome, outcome.agreement(PREDICTORS[aggregate]).pick) for outcome in outcomes]


def _counted(found: Sequence[_Cell]) -> str:
    changes = [outcome.change(setting) for outcome, setting in found]
    best = [outcome.change(outcome.oracle) for outcome, _ in found]
    better, worse = sum(change < 0 for change in changes), sum(change > 0 for change in changes)
    return (
        f"{better} of {len(changes)} improve and {worse} are worse, with a mean change of the true ATE of "
        f"{percent(mean(changes))} of {percent(mean(best))}"
    )


def _confirmed(outcomes: Sequence[Outcome]) -> str:
    taken = [(outcome, outcome.adopted) for outcome in outcomes if outcome.adopted is not None]
    if not taken:
        return ""
    return f" After a confirmation, which may keep nominal: {_counted(taken)}."


def _tested(findings: Findings) -> list[str]:
    outcomes = findings.outcomes
    lines = [_baseline(outcomes)]
    pairs = noise_pairs(outcomes, findings.weaker)
    if pairs:
        both = [f"{_levels(one)} grey levels: {_counted(picked(one, PAPERS))}" for one in zip(*pairs, strict=True)]
        lines.append(f"**Noise.** The same {len(pairs)} grids under two levels of noise. {'; '.join(both)}.")
    by_mean, by_median = (_r_squared(outcomes, name) for name in (PAPERS, AGGREGATE))
    lines.append(
        f"**Mean or median.** By the {AGGREGATE}, our default: {_counted(picked(outcomes, AGGREGATE))}; R2 with the "
        f"true ATE {plain(by_mean)} by the {PAPERS}, {plain(by_median)} by the {AGGREGATE}."
    )
    by_sequence = [
        f"{name} {percent(mean(outcome.change(setting) for outcome, setting in picked(_of(outcomes, name), PAPERS)))}"
        for name in dict.fromkeys(outcome.experiment.sequence for outcome in outcomes)
    ]
    lines.append(f"**Kind of sequence.** Mean change at the pick: {', '.join(by_sequence)}.")
    return [line for line in lines if line]


def _levels(outcomes: Sequence[Outcome]) -> str:
    return " or ".join(f"{sigma:g}" for sigma in sorted({outcome.experiment.sigma for outcome in outcomes}))


def _r_squared(outcomes: Sequence[Outcome], aggregate: str) -> float:
    return mean(outcome.agreement(PREDICTORS[aggregate]).r_squared for outcome in outcomes)


def _baseline(outcomes: Sequence[Outcome]) -> str:
    """Return what the Huber loss of the paper's GLOMAP is worth alone, and what picks gain beyond it."""
    alone, beyond, of_picks = [], [], []
    for outcome, pick in picked(outcomes, PAPERS):
        papers = next((setting for setting in outcome.feasible if setting.value == PAPERS_HUBER), None)
        if outcome.experiment.option.short == "huber" and papers is not None:
            alone.append(outcome.change(papers))
            of_picks.append(outcome.change(pick))
            beyond.append(pick.true_ate / papers.true_ate - 1)
    if not alone:
        return ""
    return (
        f"**Baseline.** Our nominal Huber loss is COLMAP 4's {COLMAPS_HUBER:g}, the paper's is {PAPERS_HUBER:g}. Over "
        f"{len(alone)} sequences {PAPERS_HUBER:g} alone changes the true ATE by {percent(mean(alone))}, the picks by "
        f"{percent(mean(of_picks))}; against {PAPERS_HUBER:g} as nominal the picks improve "
        f"{sum(change < 0 for change in beyond)} of {len(beyond)}, by {percent(mean(beyond))} on average."
    )


def _of(outcomes: Sequence[Outcome], sequence: str) -> list[Outcome]:
    return [outcome for outcome in outcomes if outcome.experiment.sequence == sequence]


def _rows(outcomes: Sequence[Outcome]) -> list[list[str]]:
    rows = []
    for name in dict.fromkeys(outcome.experiment.sequence for outcome in outcomes):
        found = {
            outcome.experiment.option.short: (outcome, pick) for outcome, pick in picked(_of(outcomes, name), PAPERS)
        }
        cells = [_cell(*found[short]) if short in found else "-" for short in OPTIONS]
        improved = sum(outcome.change(pick) < 0 for outcome, pick in found.values())
        rows.append([name, *cells, f"{improved} of {len(found)}"])
    return rows


def _cell(outcome: Outcome, pick: Setting) -> str:
    return f"{percent(outcome.change(pick))} ({percent(outcome.change(outcome.oracle))})"
