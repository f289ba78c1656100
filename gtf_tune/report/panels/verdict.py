"""What to do, how sure that is, and what it cost."""

import math
from collections import Counter
from dataclasses import dataclass

from gtf_tune.display import duration, percent, share, significant, value_text
from gtf_tune.pipelines import OptionValue
from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.axes import options_at_an_edge
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.panels.costs import StudyCost, study_cost
from gtf_tune.report.points import PointSet, TrialPoint, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.outcome.improvement import Improvement
from gtf_tune.study.outcome.recommendation import UNCONFIRMED, Recommendation
from gtf_tune.study.outcome.verdict import ADOPT, Candidate, Verdict


@dataclass(frozen=True)
class OptionChange:
    """One searched option with its nominal and its recommended value."""

    option: str
    nominal: OptionValue | None
    chosen: OptionValue


@dataclass(frozen=True)
class VerdictFacts:
    """A recommendation with what the report knows of its trial; empty and NaN where no trial is recommended.

    Attributes
    ----------
    changes
        Every searched option of the recommended trial beside nominal.
    ground_truth
        Change of the error against ground truth relative to nominal: -0.2 is a fifth smaller.
    collapsed
        Share of its noisy runs that collapsed.
    at_an_edge
        Options whose value is an end of the searched range.
    """

    recommendation: Recommendation
    changes: tuple[OptionChange, ...] = ()
    ground_truth: float = math.nan
    collapsed: float = math.nan
    at_an_edge: tuple[str, ...] = ()


def verdict_facts(data: StudyData) -> VerdictFacts:
    """Return the recommendation of a study and the facts that belong to it."""
    found = data.recommendation
    if found.trial is None:
        return VerdictFacts(found)
    points = {point.number: point for point in study_points(data).points}
    options = found.trial.options or {}  # a baseline is no trial of the search, and has no point
    chosen = points.get(found.trial.number, TrialPoint(found.trial.number, "feasible", options))
    nominal = points.get(0, TrialPoint(0, "failed"))
    names = list(chosen.options)
    at_an_edge = options_at_an_edge(data.definition.space, chosen.options, nominal.options)
    return VerdictFacts(
        recommendation=found,
        changes=tuple(OptionChange(name, nominal.options.get(name), chosen.options[name]) for name in names),
        ground_truth=chosen.ground_truth / nominal.ground_truth - 1 if nominal.ground_truth else math.nan,
        collapsed=chosen.collapsed,
        at_an_edge=at_an_edge if chosen.number else (),
    )


def compared_trials(data: StudyData) -> list[tuple[str, int]]:
    """Return name and number of the trials that are shown side by side: nominal and the one of most interest."""
    compared = [("nominal", 0)] if any(trial.number == 0 for trial in data.trials) else []
    found = data.recommendation
    if found.beside_nominal is not None:
        name = {ADOPT: "recommended", UNCONFIRMED: "best"}.get(found.decision, "lowest score")
        compared.append((name, found.beside_nominal.number))
    return compared


_MOST_CHANGES = 4


def verdict_panel(report: ReportInput) -> list[Block]:
    """Return the verdict with its options, its figures of merit, its cost and the snippets to copy."""
    data = report.data
    facts = verdict_facts(data)
    found = facts.recommendation
    blocks: list[Html] = [_headline(report, facts), _key_numbers(data, facts, study_cost(data))]
    if found.trial is not None and facts.changes and len(_changed(facts)) not in (len(facts.changes), 0):
        name = f"trial {found.trial.number}" if found.trial.number >= 0 else "recommended"
        blocks.append(_option_table(facts.changes, name))
    if data.verdict is not None and data.verdict.candidates:
        blocks.append(_candidates(data.verdict))
    if report.snippets:
        snippets = (markup.snippet(label, words) for label, words in report.snippets.items())
        blocks.append(markup.element("div", *snippets, class_="snippets"))
    return [*blocks]


def effect_sentence(improvement: Improvement) -> str:
    """Return how much less the trajectory moves than with the nominal options; empty where that is unknown."""
    if not improvement.is_known:
        return ""
    less = "less" if improvement.value >= 0 else "more"
    return f"Under image noise the trajectory moves {abs(100 * improvement.value):.0f} % {less}."


def verdict_sentences(data: StudyData, facts: VerdictFacts) -> list[str]:
    """Return what a reader must know beside the headline, one fact a sentence."""
    found = list(facts.recommendation.sentences)
    trial = facts.recommendation.trial
    if math.isfinite(facts.ground_truth) and trial is not None and trial.number:
        words = data.definition.side_metric.words
        found.append(f"Ground-truth {words} {percent(facts.ground_truth)} against nominal; the search never saw it.")
    if facts.collapsed > 0:
        found.append(
            f"{share(facts.collapsed)} of its noisy runs collapsed: its reconstructions are fragile under noise."
        )
    if facts.at_an_edge:
        found.append(
            f"The best value of {', '.join(facts.at_an_edge)} lies at an end of its range; a wider range may hold a "
            "better one."
        )
    return [*found, *_next(data, facts)]


def _next(data: StudyData, facts: VerdictFacts) -> list[str]:
    """Return the command that follows from the recommendation, where there is one to run."""
    step = facts.recommendation.step
    if step == "confirm":
        return [f"Next: gtf-tune study confirm {data.study.name}"]
    return ["Next: create a study whose nominal options work."] if step == "new study" else []


def _headline(report: ReportInput, facts: VerdictFacts) -> Html:
    """Return what to do, what changes in values, how much less the trajectory moves, what that means, and why."""
    found = facts.recommendation
    parts = [markup.element("h3", markup.text(found.headline))]
    changed = _changed(facts)
    if changed:
        lines = [markup.element("li", _change(change)) for change in changed[:_MOST_CHANGES]]
        if len(changed) > _MOST_CHANGES:
            lines.append(markup.element("li", markup.text(f"and {len(changed) - _MOST_CHANGES} more options")))
        parts.append(markup.element("ul", *lines, class_="changes"))
        effect = effect_sentence(found.improvement)
        parts += [markup.paragraph(effect, "effect")] if effect else []
        parts += [markup.paragraph(report.expected_error)] if report.expected_error else []
    parts += [markup.paragraph(sentence) for sentence in verdict_sentences(report.data, facts)]
    return markup.element("div", *parts, class_=f"verdict {found.decision.replace(' ', '-')}")


def _changed(facts: VerdictFacts) -> list[OptionChange]:
    return [change for change in facts.changes if change.chosen != change.nominal]


def _change(change: OptionChange) -> Html:
    before = "?" if change.nominal is None else value_text(change.nominal)
    arrow = markup.element("span", markup.text(" → "), aria_label="becomes", role="img")
    chosen = markup.element("strong", markup.text(value_text(change.chosen)))
    return markup.joined([markup.code(change.option), markup.text(before), arrow, chosen])


def _key_numbers(data: StudyData, facts: VerdictFacts, cost: StudyCost) -> Html:
    found, trial = study_points(data), facts.recommendation.trial
    points, unit = {point.number: point for point in found.points}, found.unit
    shown: list[tuple[str, str, str]] = []
    if 0 in points and points[0].is_scored:
        shown.append((f"nominal {unit.name}", significant(points[0].value), unit.symbol))
    if trial is not None and trial.number and points[trial.number].is_scored:
        shown.append((f"trial {trial.number}'s {unit.name}", significant(points[trial.number].value), unit.symbol))
        improvement = facts.recommendation.improvement
        sure = f"95 %: {improvement.bounds}" if math.isfinite(improvement.low) else "against nominal"
        shown.append((f"change of {unit.name}", improvement.change, sure))
        if math.isfinite(facts.ground_truth):
            shown.append(("against ground truth", percent(facts.ground_truth), "never seen by the search"))
    shown.append(("trials", str(len(data.trials)), _states(found)))
    shown.append(("runs", str(cost.made), f"{cost.reused} more reused, {cost.failed} failed"))
    confirming = f", {duration(cost.confirmation_s)} more to confirm" if cost.confirmation_runs else ""
    shown.append(("computing time", duration(cost.compute_s), f"{duration(cost.elapsed_s)} elapsed{confirming}"))
    return markup.element("div", *(_fact(*fact) for fact in shown), class_="facts")


def _states(found: PointSet) -> str:
    counts = Counter(point.state for point in found.points)
    return ", ".join(f"{number} {state}" for state, number in counts.items())


def _fact(name: str, value: str, note: str) -> Html:
    parts = (("name", name), ("value", value), ("note", note))
    return markup.element("div", *(markup.element("span", markup.text(word), class_=kind) for kind, word in parts))


def _option_table(changes: tuple[OptionChange, ...], name: str) -> Html:
    rows = [
        (
            markup.cell(markup.code(change.option)),
            "-" if change.nominal is None else value_text(change.nominal),
            markup.cell(markup.element("strong", markup.text(value_text(change.chosen))))
            if change.chosen != change.nominal
            else value_text(change.chosen),
        )
        for change in changes
    ]
    return markup.table(["option", ">nominal", f">{name}"], rows, "Options")


def _candidates(verdict: Verdict) -> Html:
    sequences = list(verdict.candidates[0].by_sequence)
    rows = [
        (
            candidate.baseline or candidate.number,
            candidate.improvement.change,
            candidate.improvement.bounds,
            significant(candidate.adjusted_p_value, 2),
            *(_change_on(name, candidate) for name in sequences),
            "passes" if candidate.passes else "does not pass",
            "; ".join(candidate.reasons) or "-",
        )
        for candidate in verdict.candidates
    ]
    head = [">candidate", ">change", ">95 % interval", ">p (Holm)", *(f">on {name}" for name in sequences)]
    title = markup.element("h3", markup.text("Confirmation on fresh noise"))
    return markup.joined([title, markup.table([*head, "result", "against it"], rows, "Confirmation")])


def _change_on(sequence: str, candidate: Candidate) -> str:
    return candidate.by_sequence[sequence].improvement.change if sequence in candidate.by_sequence else "-"


PANEL = Panel("Verdict", verdict_panel)
