"""Turn outcomes into tables of Markdown cells."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from experiments.findings import share_of_oracle
from experiments.joint import Joint, sweeps_of
from experiments.k_delta import Curve, picks
from experiments.ladder import Ladder
from experiments.numbers import Table, mean, percent, plain, share, significant
from experiments.paper.numbers import ROWS
from experiments.plan import AGGREGATE, OPTIONS, TRUTHS, UNKNOWN_TRUTH
from experiments.settings import AGGREGATES, PREDICTORS, Outcome, Setting
from experiments.unseen import SCORERS, share_on_unseen
from gtf_tune.gtf import find_collapsed

COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 60)


def table_2(outcomes: Sequence[Outcome]) -> Table:
    """Return the picks in the shape of the paper's table."""
    columns = ["sequence (sigma)", "ground truth", "nominal ATE", *(one.paper_column for one in OPTIONS.values())]
    rows = []
    for name in dict.fromkeys(outcome.experiment.sequence for outcome in outcomes):
        mine = {outcome.experiment.option.short: outcome for outcome in outcomes if outcome.experiment.sequence == name}
        first = next(iter(mine.values()))
        cells = [_cell(mine[short]) if short in mine else "not measured" for short in OPTIONS]
        truth = TRUTHS.get(name, UNKNOWN_TRUTH)
        nominal = f"{first.nominal.true_ate:.4g} {truth.unit}".rstrip()
        rows.append([f"{name} ({first.experiment.sigma:g})", truth.quality, nominal, *cells])
    return columns, rows


def _cell(outcome: Outcome) -> str:
    pick = outcome.agreement(PREDICTORS[AGGREGATE]).pick
    verdict = outcome.verdict
    if outcome.adopted is not None and outcome.adopted.number:
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
    columns = ["predictor", "grids", "R2", "Spearman", "change of true ATE", "share of the oracle"]
    columns += ["share on unseen images", "regressions"]
    rows = []
    for name, predictor in PREDICTORS.items():
        found = [(one, one.agreement(predictor)) for one in outcomes if one.knows(predictor)]
        changes = [outcome.change(agreement.pick) for outcome, agreement in found]
        reached, _ = share_of_oracle(outcomes, name)
        unseen, _ = share_on_unseen(outcomes, SCORERS[name]) if name in SCORERS else (math.nan, 0)
        rows.append(
            [
                name,
                str(len(found)),
                plain(mean(agreement.r_squared * np.sign(agreement.correlation) for _, agreement in found)),
                plain(mean(agreement.spearman for _, agreement in found)),
                percent(mean(changes)),
                share(reached),
                share(unseen),
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
    if not outcome.knows(predictor):
        return "-"
    found = outcome.agreement(predictor)
    signed = found.r_squared * float(np.sign(found.correlation))
    return f"{plain(signed)} / {plain(found.spearman)} / {percent(outcome.change(found.pick))}"


def shortfall_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the picks that miss the oracle, with the reason."""
    rows = []
    for outcome in outcomes:
        pick, oracle = outcome.agreement(PREDICTORS[AGGREGATE]).pick, outcome.oracle
        if outcome.change(pick) - outcome.change(oracle) <= 0.01:
            continue
        sound = ~(find_collapsed(oracle.matrix) | find_collapsed(pick.matrix))
        logs = np.log(oracle.matrix / pick.matrix).mean(axis=0)[sound]
        gap, spread = float(logs.mean()), float(logs.std(ddof=1))
        half = float(stats.t.ppf(0.975, len(logs) - 1)) * spread / math.sqrt(len(logs))
        certain = abs(gap) > half
        needed = f"about {math.ceil((2.8 * spread / max(abs(gap), 1e-9)) ** 2)}"
        if certain:
            needed = "more do not help" if gap > 0 else "enough, compared in pairs"
        one = outcome.experiment
        rows.append(
            [
                f"{one.sequence} {one.option.short}",
                f"{pick.value:g}: {percent(outcome.change(pick))}",
                f"{oracle.value:g}: {percent(outcome.change(oracle))}",
                f"{percent(math.expm1(gap))} ({' to '.join(percent(math.expm1(gap + end)) for end in (-half, half))})",
                f"{oracle.collapsed:.0%}",
                needed,
            ]
        )
    return [
        "experiment",
        "pick",
        "oracle",
        "score of oracle's against pick's, 95 % interval",
        "oracle's collapses",
        "noisy runs",
    ], rows


def k_delta_table(curves: Sequence[Curve]) -> Table:
    """Return R2 for numbers of noisy runs, one row for each experiment and aggregate."""
    if not curves:
        return ["experiment"], []
    counts = [count for count in COUNTS if count <= max(curve.counts[-1] for curve in curves)]
    rows = []
    for curve in curves:
        for name, values in curve.r_squared.items():
            known = dict(zip(curve.counts, values, strict=True))
            cells = [plain(known[count]) if count in known else "-" for count in counts]
            rows.append([f"{curve.study} {name}", *cells])
    return ["experiment", *(f"k_delta {count}" for count in counts)], rows


def fragile_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the settings that are infeasible or that collapse."""
    rows = []
    for outcome in outcomes:
        for setting in outcome.settings:
            if setting.feasible and not setting.collapsed:
                continue
            name = f"{outcome.experiment.sequence} {outcome.experiment.option.short} = {setting.value:g}"
            state = "feasible" if setting.feasible else "infeasible"
            change = percent(outcome.change(setting))
            rows.append([name, state, f"{setting.coverage:.0%}", f"{setting.collapsed:.0%}", change])
    return ["setting", "", "least coverage", "noisy runs collapsed", "true ATE against nominal"], rows


def ladder_table(ladders: Sequence[Ladder]) -> Table:
    """Return one row for each level of each ladder."""
    rows = []
    for ladder in ladders:
        rows.append([ladder.sequence, "0", significant(1000 * ladder.floor), *["-"] * 4, "floor"])
        for rung in ladder.rungs:
            mark = "recommended" if rung.sigma == ladder.recommended else "linear" if rung.linear else ""
            signal = math.sqrt(rung.score**2 - ladder.floor**2) if rung.score > ladder.floor else math.nan
            numbers = [significant(value) for value in (1000 * rung.score, 1000 * signal / rung.sigma)]
            numbers += ["-" if value is None else significant(value) for value in (rung.spread, rung.true_ate)]
            rows.append([ladder.sequence, f"{rung.sigma:g}", *numbers, str(rung.collapsed), mark])
    columns = ["sequence", "sigma", "score [‰]", "response [‰ / grey]", "spread", "true ATE of noisy runs"]
    return [*columns, "collapsed", ""], rows


def ablation_table(ablated: Sequence[Outcome]) -> Table:
    """Return options by how much the true ATE changes over their values, the largest first."""
    rows = []
    for outcome in ablated:
        changes = [outcome.change(one) for one in outcome.feasible]
        scores = [PREDICTORS[AGGREGATE](one) for one in outcome.feasible]
        lost = len(outcome.settings) - len(outcome.feasible)
        span = max(changes) - min(changes)
        option = outcome.experiment.option
        score_range = f"{percent(min(scores) / scores[0] - 1)} to {percent(max(scores) / scores[0] - 1)}"
        true_range = f"{percent(min(changes))} to {percent(max(changes))}"
        values = ", ".join(f"{setting.value:g}" for setting in outcome.settings[1:])
        rows.append(
            (
                span,
                [
                    outcome.experiment.sequence,
                    option.paper_column,
                    f"`{option.name}`",
                    values,
                    true_range,
                    score_range,
                    str(lost),
                ],
            )
        )
    ranked = [row for _, row in sorted(rows, key=lambda item: -item[0])]
    return ["sequence", "paper's name", "option", "values", "true ATE", "score", "infeasible"], ranked


def joint_table(joints: Sequence[Joint], outcomes: Sequence[Outcome]) -> Table:
    """Return joint searches beside the sweeps of one option on the same sequence."""
    rows = []
    for joint in joints:
        for experiment, runs, change in sweeps_of(joint.sequence, outcomes):
            rows.append([joint.sequence, f"sweep of `{experiment.option.name}`", str(runs), percent(change), "", ""])
        adopted = "" if joint.adopted is None else f" {percent(joint.change(joint.adopted))}"
        rows.append(
            [
                joint.sequence,
                f"all five by {joint.sampler}, {joint.trials} trials",
                str(joint.runs),
                f"**{percent(joint.change(joint.pick))}**",
                percent(joint.change(joint.oracle)),
                f"{joint.verdict}{adopted}",
            ]
        )
    return ["sequence", "search", "runs", "true ATE at the pick", "best trial by truth", "confirmation"], rows


def trap_table(traps: Sequence[Outcome]) -> Table:
    """Return every setting of the grids over options that drop frames."""
    rows = []
    for outcome in traps:
        pick = outcome.agreement(PREDICTORS[AGGREGATE]).pick
        for one in sorted(outcome.settings, key=lambda setting: setting.value):
            name = f"{outcome.experiment.sequence}, `{outcome.experiment.option.name}` = {one.value:g}"
            mark = " and picked" if one.number == pick.number else ""
            state = "feasible" if one.feasible else "infeasible"
            rows.append([name, f"{one.coverage:.0%}", percent(outcome.change(one)), f"{state}{mark}"])
    return ["setting", "least coverage", "true ATE over registered frames", ""], rows
