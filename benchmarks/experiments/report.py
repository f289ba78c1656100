"""Turn outcomes into docs/results.md and docs/results.json; every number comes from the database."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experiments.ablation import WITHOUT_SUCCESSOR
from benchmarks.experiments.k_delta import picks, r_squared_by_count
from benchmarks.experiments.ladder import Ladder
from benchmarks.experiments.numbers import Table, known, mean, part, percent, plain, significant
from benchmarks.experiments.paper import ROWS
from benchmarks.experiments.plan import OPTIONS
from benchmarks.experiments.settings import AGGREGATES, PREDICTORS, Outcome, Setting
from gtf_tune.gtf import find_collapsed

WORTH_FINDING = 0.03
"""Oracle's gain from which on a pick is asked to reach most of it."""

AIM = 0.9

_COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 60)


@dataclass(frozen=True)
class Findings:
    """Hold all that is measured: table 2, grids with many noisy runs, ablation, noise ladders; and what is missing."""

    outcomes: Sequence[Outcome]
    many: Sequence[Outcome]
    ablated: Sequence[Outcome]
    ladders: Sequence[Ladder]
    missing: Sequence[str]


def write_results(findings: Findings, folder: Path) -> None:
    """Write both files into ``folder``."""
    outcomes, many = findings.outcomes, findings.many
    parts = [
        _introduction(findings),
        part("The paper's table 2, here", _TABLE_2, table_2(outcomes)),
        part("The paper's table 2, there", _PAPER, paper_table()),
        part("Which aggregate", _AGGREGATES, summary_table(outcomes)),
        part("Which aggregate, over many choices of noisy runs", _PICKS, picks_table(outcomes, many)),
        part("Every experiment and predictor", _PREDICTORS, predictor_table(outcomes)),
        part("Why a pick is not the best", _SHORTFALL, shortfall_table(outcomes)),
        part("How many noisy runs", _K_DELTA, k_delta_table(many)),
        part("Noise ladder", _LADDER, ladder_table(findings.ladders)),
        part("Which options matter", _ABLATION, ablation_table(findings.ablated)),
        part("Settings that lose frames or collapse", _FRAGILE, fragile_table(outcomes)),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    data = {
        "experiments": [_as_data(one) for one in outcomes],
        "k_delta": [_k_delta_data(one) for one in many],
        "ablation": [_as_data(one) for one in findings.ablated],
        "ladders": [_ladder_data(one) for one in findings.ladders],
        "not_measured": list(findings.missing),
    }
    (folder / "results.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


_TABLE_2 = (
    "In each cell: what GTF ATE picks, what confirmation made of it, and what ground truth would have picked, as "
    "changes of the true ATE against nominal (negative is better). The pick is by `gmean`, the aggregate "
    "of these studies; the median became the default because of what follows."
)
_PAPER = "Changes of the true ATE by GTF ATE and, in brackets, by ground truth, as printed; negative is better."
_AGGREGATES = (
    'Averages over all experiments. "share of the oracle" is the part of the possible gain that the pick reaches, over '
    f"experiments where ground truth gains more than {WORTH_FINDING:.0%} (a loss counts as -100 % at the most); "
    '"regressions" counts unconfirmed picks that are worse than nominal by more than 1 %. R2 counts with the sign of '
    "the correlation."
)
_PICKS = (
    "For each experiment 200 random choices of half of its noisy runs: change of the true ATE at the pick on average / "
    "in the worst tenth / share of picks worse than nominal by more than 1 %."
)
_PREDICTORS = (
    "R2 of a line through predictor and true ATE with the sign of the correlation, Spearman's rank correlation, and "
    "the change of the true ATE at the pick."
)
_SHORTFALL = (
    "Experiments whose pick (aggregate `gmean`) misses the oracle by more than 1 % of the true ATE. The gap compares "
    "the scores of both settings, paired by noise instance, without collapsed ones. Where it is certain, more noisy "
    "runs do not help: the score prefers another setting than the truth does. Otherwise the last column says how many "
    "would settle which of the two the score prefers (power 80 %)."
)
_K_DELTA = (
    "R2 between score and true ATE for numbers of noisy runs, averaged over random choices among those there are "
    "(the paper shows 1 to 60)."
)
_LADDER = (
    "Nominal setting over noise levels; level 0 is clean runs against other clean runs. Where the response per grey "
    "level is constant the pipeline is linear (the paper's assumption); `gtf-tune noise` measures this on any sequence."
)
_ABLATION = (
    "The paper's 26 options, as far as COLMAP 4 still has them, on one sequence, each at a stricter and a laxer value "
    "(the five of table 2 over their grids); ranges of the true ATE and of the score against nominal. "
    f"Without a successor: {'; '.join(WITHOUT_SUCCESSOR)}."
)
_FRAGILE = (
    "Settings that ran into the coverage floor, or whose noisy runs collapsed, with their true ATE against nominal."
)


def table_2(outcomes: Sequence[Outcome]) -> Table:
    """Return the picks in the shape of the paper's table."""
    columns = ["sequence (sigma)", "nominal ATE", *(one.paper_column for one in OPTIONS.values())]
    rows = []
    for name in dict.fromkeys(one.experiment.sequence for one in outcomes):
        mine = {one.experiment.option.short: one for one in outcomes if one.experiment.sequence == name}
        first = next(iter(mine.values()))
        cells = [_cell(mine[short]) if short in mine else "not measured" for short in OPTIONS]
        rows.append([f"{name} ({first.experiment.sigma:g})", f"{first.nominal.true_ate:.4g}", *cells])
    return columns, rows


def _cell(outcome: Outcome) -> str:
    pick = outcome.agreement(PREDICTORS["gmean"]).pick
    verdict = outcome.verdict
    if outcome.adopted is not None and outcome.adopted.ordinal:
        verdict = f"adopt {percent(outcome.change(outcome.adopted))}"
    return f"pick {percent(outcome.change(pick))}<br>{verdict}<br>oracle {percent(outcome.change(outcome.oracle))}"


def paper_table() -> Table:
    """Return the paper's table."""
    rows = []
    for row in ROWS:
        cells = [f"{-row.improvements[short][0]:+.1f} % ({-row.improvements[short][1]:+.1f} %)" for short in OPTIONS]
        rows.append([row.sequence, row.nominal, *cells])
    return ["sequence", "nominal ATE", *(one.paper_column for one in OPTIONS.values())], rows


def summary_table(outcomes: Sequence[Outcome]) -> Table:
    """Return one row for each predictor, averaged over experiments."""
    columns = ["predictor", "R2", "Spearman", "change of true ATE", "share of the oracle", "regressions"]
    rows = []
    for name, predictor in PREDICTORS.items():
        found = [(one, one.agreement(predictor)) for one in outcomes]
        changes = [outcome.change(agreement.pick) for outcome, agreement in found]
        shares = [
            max(outcome.change(agreement.pick) / outcome.change(outcome.oracle), -1.0)
            for outcome, agreement in found
            if outcome.change(outcome.oracle) < -WORTH_FINDING
        ]
        rows.append(
            [
                name,
                plain(mean(agreement.r_squared * np.sign(agreement.correlation) for _, agreement in found)),
                plain(mean(agreement.spearman for _, agreement in found)),
                percent(mean(changes)),
                f"{mean(shares):.0%}" if shares else "-",
                f"{sum(change > 0.01 for change in changes)} of {len(changes)}",
            ]
        )
    return columns, rows


def picks_table(outcomes: Sequence[Outcome], many: Sequence[Outcome]) -> Table:
    """Return what picks are worth over random choices of noisy runs, by aggregate."""
    rows = []
    found: dict[str, list[float]] = {aggregate: [] for aggregate in AGGREGATES}
    for outcome in [*many, *outcomes]:
        available = outcome.nominal.matrix.shape[1]
        cells = []
        for aggregate in AGGREGATES:
            one = picks(outcome, aggregate, available // 2)
            found[aggregate].append(one.mean)
            cells.append(f"{percent(one.mean)} / {percent(one.worst_decile)} / {one.regressions:.0%}")
        experiment = outcome.experiment
        name = f"{experiment.sequence} {experiment.option.short}, {available // 2} of {available}"
        rows.append([name, *cells, percent(outcome.change(outcome.oracle))])
    if rows:
        rows.append(["average", *(percent(mean(found[aggregate])) for aggregate in AGGREGATES), ""])
    return ["experiment", *AGGREGATES, "oracle"], rows


def predictor_table(outcomes: Sequence[Outcome]) -> Table:
    """Return one row for each experiment, one column for each predictor."""
    rows = []
    for outcome in outcomes:
        cells = [_agreement_cell(outcome, PREDICTORS[name]) for name in PREDICTORS]
        one = outcome.experiment
        rows.append([f"{one.sequence} {one.option.short}", *cells, percent(outcome.change(outcome.oracle))])
    return ["experiment", *PREDICTORS, "oracle"], rows


def _agreement_cell(outcome: Outcome, predictor: Callable[[Setting], float]) -> str:
    found = outcome.agreement(predictor)
    signed = found.r_squared * float(np.sign(found.correlation))
    return f"{plain(signed)} / {plain(found.spearman)} / {percent(outcome.change(found.pick))}"


def shortfall_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the picks that miss the oracle, with the reason."""
    rows = []
    for outcome in outcomes:
        pick, oracle = outcome.agreement(PREDICTORS["gmean"]).pick, outcome.oracle
        if outcome.change(pick) - outcome.change(oracle) <= 0.01:
            continue
        sound = ~(find_collapsed(oracle.matrix) | find_collapsed(pick.matrix))
        logs = np.log(oracle.matrix / pick.matrix).mean(axis=0)[sound]
        gap, spread = float(logs.mean()), float(logs.std(ddof=1))
        certain = abs(gap) > 2.0 * spread / math.sqrt(len(logs))
        needed = "more do not help" if certain else f"about {math.ceil((2.8 * spread / max(abs(gap), 1e-9)) ** 2)}"
        one = outcome.experiment
        rows.append(
            [
                f"{one.sequence} {one.option.short}",
                f"{pick.value:g}: {percent(outcome.change(pick))}",
                f"{oracle.value:g}: {percent(outcome.change(oracle))}",
                f"{percent(math.exp(gap) - 1)} +- {spread / math.sqrt(len(logs)):.0%}",
                f"{oracle.collapsed:.0%}",
                needed,
            ]
        )
    return [
        "experiment",
        "pick",
        "oracle",
        "score of oracle's against pick's",
        "oracle's collapses",
        "noisy runs",
    ], rows


def k_delta_table(many: Sequence[Outcome]) -> Table:
    """Return R2 for numbers of noisy runs, one row for each experiment and aggregate."""
    if not many:
        return ["experiment"], []
    most = max(one.nominal.matrix.shape[1] for one in many)
    counts = [count for count in _COUNTS if count <= most]
    rows = []
    for outcome in many:
        for aggregate in AGGREGATES:
            found = r_squared_by_count(outcome, aggregate, counts)
            name = f"{outcome.experiment.sequence} {outcome.experiment.option.short} {aggregate}"
            rows.append([name, *(plain(value) for value in found)])
    return ["experiment", *(f"k_delta {count}" for count in counts)], rows


def fragile_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the settings that are infeasible or that collapse."""
    rows = []
    for outcome in outcomes:
        for one in outcome.settings:
            if one.feasible and not one.collapsed:
                continue
            name = f"{outcome.experiment.sequence} {outcome.experiment.option.short} = {one.value:g}"
            state = "feasible" if one.feasible else "infeasible"
            change = percent(outcome.change(one))
            rows.append([name, state, f"{one.coverage:.0%}", f"{one.collapsed:.0%}", change])
    return ["setting", "", "least coverage", "noisy runs collapsed", "true ATE against nominal"], rows


def ladder_table(ladders: Sequence[Ladder]) -> Table:
    """Return one row for each level of each ladder."""
    rows = []
    for one in ladders:
        scale = one.scale
        rows.append([one.sequence, "0", significant(1000 * scale.floor.score), *["-"] * 3, "0", "floor"])
        levels = zip(scale.levels, scale.responses, scale.ratios, scale.linear, one.true_ates, strict=True)
        for level, response, ratio, inside, true_ate in levels:
            mark = "recommended" if level.sigma == scale.recommended else "linear" if inside else ""
            numbers = [significant(value) for value in (1000 * level.score, 1000 * response, ratio, true_ate)]
            rows.append([one.sequence, f"{level.sigma:g}", *numbers, f"{level.collapsed}/{level.runs}", mark])
    columns = ["sequence", "sigma", "score [‰]", "response [‰ / grey]", "signal / spread", "true ATE of noisy runs"]
    return [*columns, "collapsed", ""], rows


def ablation_table(ablated: Sequence[Outcome]) -> Table:
    """Return options by how much the true ATE changes over their values, the largest first."""
    rows = []
    for outcome in ablated:
        changes = [outcome.change(one) for one in outcome.feasible]
        scores = [PREDICTORS["gmean"](one) for one in outcome.feasible]
        lost = len(outcome.settings) - len(outcome.feasible)
        span = max(changes) - min(changes)
        option = outcome.experiment.option
        score_range = f"{percent(min(scores) / scores[0] - 1)} to {percent(max(scores) / scores[0] - 1)}"
        true_range = f"{percent(min(changes))} to {percent(max(changes))}"
        values = ", ".join(f"{one.value:g}" for one in outcome.settings[1:])
        rows.append((span, [option.paper_column, f"`{option.name}`", values, true_range, score_range, str(lost)]))
    ranked = [row for _, row in sorted(rows, key=lambda item: -item[0])]
    return ["paper's name", "option", "values", "true ATE", "score", "infeasible"], ranked


def _introduction(findings: Findings) -> str:
    outcomes, missing = findings.outcomes, findings.missing
    confirmed = [one for one in outcomes if one.adopted is not None]
    adopted = [one for one in confirmed if one.adopted is not None and one.adopted.ordinal]
    worse = [one for one in adopted if one.adopted is not None and one.change(one.adopted) > 0]
    lines = [
        "# Results",
        "",
        "Written by `make experiments`; every number comes from the runs. True errors are against ground truth, which "
        "neither search nor confirmation sees. GLOMAP (pycolmap), intrinsics known and fixed, one thread a run, two "
        "clean and six noisy runs a setting unless said otherwise, one option at a time.",
        "",
        f"* Measured: {len(outcomes)} grids of table 2, {len(findings.many)} with many noisy runs, "
        f"{len(findings.ablated)} of the ablation, {len(findings.ladders)} noise ladders.",
        f"* Confirmed on fresh noise: {len(confirmed)}; adopted: {len(adopted)}; of these worse than nominal in true "
        f"ATE: {len(worse)}.",
    ]
    worth = [one for one in outcomes if one.change(one.oracle) < -WORTH_FINDING]
    if worth:
        reached = mean(one.change(one.agreement(PREDICTORS["gmean"]).pick) / one.change(one.oracle) for one in worth)
        lines.append(
            f"* Of the oracle's gain, where it exceeds {WORTH_FINDING:.0%} ({len(worth)} grids), picks reach "
            f"{reached:.0%} on average; the aim of {AIM:.0%} is {'met' if reached >= AIM else 'missed'}. The reasons "
            "are below, grid by grid."
        )
    if missing:
        lines.append(f"* Not measured yet: {', '.join(missing)}.")
    return "\n".join(lines)


def _as_data(outcome: Outcome) -> dict[str, Any]:
    return {
        "study": outcome.experiment.study,
        "option": outcome.experiment.option.name,
        "verdict": outcome.verdict,
        "adopted": None if outcome.adopted is None else outcome.adopted.value,
        "oracle": outcome.oracle.value,
        "picks": {name: outcome.agreement(predictor).pick.value for name, predictor in PREDICTORS.items()},
        "settings": [
            {
                "value": one.value,
                "feasible": one.feasible,
                "coverage": one.coverage,
                "true_ate": known(one.true_ate),
                "collapsed": one.collapsed,
                "reprojection_px": known(one.reprojection_px),
                "clean_clean": known(one.clean_clean),
                "matrix": [[known(value) for value in row] for row in one.matrix.tolist()],
            }
            for one in outcome.settings
        ],
    }


def _ladder_data(ladder: Ladder) -> dict[str, Any]:
    scale = ladder.scale
    levels = [
        {"sigma": level.sigma, "score": known(level.score), "true_ate": known(true_ate), "collapsed": level.collapsed}
        for level, true_ate in zip(scale.levels, ladder.true_ates, strict=True)
    ]
    return {
        "sequence": ladder.sequence,
        "floor": known(scale.floor.score),
        "levels": levels,
        "recommended": scale.recommended,
    }


def _k_delta_data(outcome: Outcome) -> dict[str, Any]:
    counts = list(range(1, outcome.nominal.matrix.shape[1] + 1))
    found: dict[str, Any] = {name: r_squared_by_count(outcome, name, counts) for name in AGGREGATES}
    return {"study": outcome.experiment.study, "counts": counts, "r_squared": found}
