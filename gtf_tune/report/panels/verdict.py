"""What to do, how sure that is, and what it cost."""

import math
from collections import Counter
from collections.abc import Sequence

from gtf_tune.display import count, definition_unit, duration, percent, share, significant, value_text
from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.panels.costs import StudyCost, study_cost
from gtf_tune.report.points import PointSet, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.verdict import Candidate, Verdict, study_verdict
from gtf_tune.study.outcome.verdicts import NO_VERDICT


def verdict_panel(report: ReportInput) -> list[Block]:
    """Return the verdict with its options, its figures of merit, its cost and the snippets to copy."""
    data = report.data
    verdict = study_verdict(data)
    headline = markup.element("h3", markup.text(verdict_headline(verdict)))
    sentences = [markup.paragraph(sentence) for sentence in verdict_sentences(data, verdict)]
    blocks: list[Html] = [markup.element("div", headline, *sentences, class_=f"verdict {verdict.kind}")]
    blocks.append(_key_numbers(data, verdict, study_cost(data)))
    if verdict.changes:
        blocks.append(_changes(verdict))
    if verdict.candidates:
        blocks.append(_candidates(verdict.candidates))
    if report.snippets:
        snippets = (markup.snippet(label, words) for label, words in report.snippets.items())
        blocks.append(markup.element("div", *snippets, class_="snippets"))
    return [*blocks]


def verdict_headline(verdict: Verdict) -> str:
    """Return the verdict in a few words."""
    if verdict.kind == "adopt":
        return f"Adopt the options of trial {verdict.number}"
    if verdict.kind == "keep":
        return "Keep the nominal options"
    if verdict.kind == "neither":
        return "Neither the nominal options nor others are recommended"
    if verdict.kind == "unconfirmed":
        return f"Trial {verdict.number} is the best so far; not confirmed yet"
    return "No verdict yet" if verdict.number is None else "Keep the nominal options so far"


def verdict_sentences(data: StudyData, verdict: Verdict) -> list[str]:
    """Return what a reader must know beside the headline, one fact a sentence."""
    found = [_main_sentence(data, verdict)]
    if math.isfinite(verdict.ground_truth) and verdict.number:
        found.append(
            f"Against ground truth, which the search never saw, its error is {_better_or_worse(verdict.ground_truth)}."
        )
    if verdict.collapsed > 0:
        found.append(
            f"{share(verdict.collapsed)} of its noisy runs collapsed: its reconstructions are fragile under noise."
        )
    if verdict.at_an_edge:
        found.append(
            f"The best value of {', '.join(verdict.at_an_edge)} lies at an end of its range; a wider range may hold a "
            "better one."
        )
    return found


def _main_sentence(data: StudyData, verdict: Verdict) -> str:
    unit = definition_unit(data.definition)
    name, better, sure = unit.name, _better_or_worse(verdict.improvement.value), _interval(verdict)
    if verdict.kind == "adopt":
        return f"With fresh seeds its {name} is {better} than that of the nominal options{sure}."
    if verdict.kind == "keep":
        if not verdict.candidates:
            return f"No trial had a smaller {name} than nominal in the search, so there was nothing to confirm."
        return (
            f"With fresh seeds none of {count(len(verdict.candidates), 'candidate')} passed every test; the table says "
            "what speaks against each."
        )
    if verdict.kind == "neither":
        return f"{_why_neither(data)}: create a study whose nominal options work."
    if verdict.kind == "unconfirmed" and data.nominal is None:
        return f"The nominal options are infeasible, so there is nothing to compare its {name} with."
    if verdict.kind == "unconfirmed":
        doubt = "" if verdict.is_distinct else " The interval does not exclude that they are equal."
        return (
            f"Its {name} is {_better_or_worse(1 - verdict.ratio)} than nominal; noise instance by noise instance it is "
            f"{better}{sure}.{doubt} These are the runs that made it the best of {count(len(data.feasible), 'trial')}, "
            f"which flatters it: confirm it with fresh seeds by gtf-tune study confirm {data.study.name}"
        )
    if verdict.number is None:
        return f"None of {count(len(data.trials), 'trial')} is feasible and complete so far."
    return f"None of {count(len(data.feasible) - 1, 'other feasible trial')} has a smaller {name} than nominal."


def _why_neither(data: StudyData) -> str:
    if data.confirmations[-1].verdict == NO_VERDICT:
        return "With fresh seeds the nominal options did not work, so there was nothing to compare with"
    return "With fresh seeds no candidate passed every test, and the nominal options were infeasible in the search"


def _better_or_worse(improvement: float) -> str:
    if not math.isfinite(improvement):
        return "different by an unknown amount"
    return f"{100 * abs(improvement):.1f} % {'smaller' if improvement >= 0 else 'larger'}"


def _interval(verdict: Verdict) -> str:
    low, high = verdict.improvement.low, verdict.improvement.high
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f" (95 % interval of the improvement {100 * low:.1f} to {100 * high:.1f} %)"


def _key_numbers(data: StudyData, verdict: Verdict, cost: StudyCost) -> Html:
    found = study_points(data)
    points, unit = {point.number: point for point in found.points}, found.unit
    facts: list[tuple[str, str, str]] = []
    if 0 in points and points[0].is_scored:
        facts.append((f"nominal {unit.name}", significant(points[0].value), unit.symbol))
    if verdict.number and points[verdict.number].is_scored:
        facts.append((f"trial {verdict.number}'s {unit.name}", significant(points[verdict.number].value), unit.symbol))
        low, high = verdict.improvement.low, verdict.improvement.high
        sure = f"95 %: {100 * low:.1f} to {100 * high:.1f} %" if math.isfinite(low) else "against nominal"
        facts.append(("improvement", percent(verdict.improvement.value), sure))
    if verdict.number and math.isfinite(verdict.ground_truth):
        facts.append(("against ground truth", percent(verdict.ground_truth), "side metric"))
    facts.append(("trials", str(len(data.trials)), _states(found)))
    facts.append(("runs", str(cost.made), f"{cost.reused} more reused, {cost.failed} failed"))
    facts.append(("computing time", duration(cost.compute_s), f"{duration(cost.elapsed_s)} elapsed"))
    if cost.confirmation_runs:
        facts.append(("confirmation", duration(cost.confirmation_s), count(cost.confirmation_runs, "run")))
    return markup.element("div", *(_fact(*fact) for fact in facts), class_="facts")


def _states(found: PointSet) -> str:
    counts = Counter(point.state for point in found.points)
    return ", ".join(f"{number} {state}" for state, number in counts.items())


def _fact(name: str, value: str, note: str) -> Html:
    parts = (("name", name), ("value", value), ("note", note))
    return markup.element("div", *(markup.element("span", markup.text(word), class_=kind) for kind, word in parts))


def _changes(verdict: Verdict) -> Html:
    rows = [
        (
            markup.cell(markup.code(change.option)),
            "-" if change.nominal is None else value_text(change.nominal),
            markup.cell(markup.element("strong", markup.text(value_text(change.chosen))))
            if change.chosen != change.nominal
            else value_text(change.chosen),
        )
        for change in verdict.changes
    ]
    return markup.table(["option", ">nominal", f">trial {verdict.number}"], rows)


def _candidates(candidates: Sequence[Candidate]) -> Html:
    sequences = list(candidates[0].by_sequence)
    rows = [
        (
            one.number,
            percent(one.improvement.value),
            _ends(one),
            significant(one.p_value, 2),
            *(percent(one.by_sequence[name].value) if name in one.by_sequence else "-" for name in sequences),
            "adopt" if one.is_adopted else "keep nominal",
            "; ".join(one.reasons) or "-",
        )
        for one in candidates
    ]
    head = [">candidate", ">improvement", ">95 % interval", ">p (Holm)", *(f">on {name}" for name in sequences)]
    title = markup.element("h4", markup.text("Confirmation with fresh seeds"))
    return markup.joined([title, markup.table([*head, "verdict", "against it"], rows)])


def _ends(candidate: Candidate) -> str:
    found = candidate.improvement
    return f"{percent(found.low)} to {percent(found.high)}" if math.isfinite(found.low) else "-"


PANEL = Panel("Verdict", verdict_panel)
