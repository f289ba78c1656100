"""Turn outcomes into docs/results-appendix.md and docs/results.json; every number comes from the database."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments import tables, text
from experiments.figures import FOLDER, write_figures
from experiments.findings import (
    AIM,
    WORTH_FINDING,
    Findings,
    share_of_oracle,
    share_of_verdicts,
)
from experiments.fresh import fresh_sentence, fresh_table
from experiments.holds import holds_part
from experiments.numbers import known, part, percent
from experiments.plan import CONFIRMATION_RUNS, FRAMES, TOP, TRUTHS, UNKNOWN_TRUTH
from experiments.settings import PREDICTORS, Outcome, Setting
from experiments.several import several_table
from experiments.unseen import picks_on_unseen, shares, unseen_table
from experiments.weaker import noise_pairs, noise_sentence, noise_table

_HEAD = "# Appendix: the paper's experiments\n\n[Results](results.md) has the short answer."


def write_results(findings: Findings, folder: Path) -> None:
    """Write results-appendix.md, results.json and the figures into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = write_figures(findings, folder / FOLDER)
    page = "\n\n".join([_HEAD, holds_part(findings), _introduction(findings), *_parts(findings, drawn)])
    (folder / "results-appendix.md").write_text(page + "\n", encoding="utf-8")
    data = {
        "experiments": [_as_data(outcome) for outcome in findings.outcomes],
        "weaker_noise": [_as_data(one) for one in findings.weaker],
        "many": [_as_data(one) for one in findings.many],
        "k_delta": [asdict(curve) for curve in findings.curves],
        "traps": [_as_data(trap) for trap in findings.traps],
        "joint": [asdict(joint) for joint in findings.joints],
        "several": [asdict(one) for one in findings.several],
        "fresh": [{name: _plain(value) for name, value in asdict(one).items()} for one in findings.fresh],
        "ablation": [_as_data(one) for one in findings.ablated],
        "ladders": [asdict(ladder) for ladder in findings.ladders],
        "not_measured": list(findings.missing),
    }
    (folder / "results.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def _parts(findings: Findings, drawn: Sequence[str]) -> list[str]:
    outcomes, many = findings.outcomes, findings.many
    figures = {
        name: f"\n\n![{label}]({FOLDER}/{name}.svg)" if name in drawn else "" for name, label in text.FIGURES.items()
    }
    return [
        part("The paper's table 2, here", text.TABLE_2 + figures["gains"], tables.table_2(outcomes)),
        part("Confirmations, judged on their own noise", text.FRESH, fresh_table(findings.fresh)),
        part("The paper's table 2, there", text.PAPER, tables.paper_table()),
        part("Which aggregate, which estimator", text.AGGREGATES, tables.summary_table(outcomes)),
        part("The same with weaker noise", text.WEAKER, noise_table(noise_pairs(outcomes, findings.weaker))),
        part("Every predictor with weaker noise", text.WEAKER_PREDICTORS, tables.predictor_table(findings.weaker)),
        part("Which aggregate, over many choices of noisy runs", text.PICKS, tables.picks_table(outcomes, many)),
        part("Every experiment and predictor", text.PREDICTORS, tables.predictor_table(outcomes)),
        part("Why a pick is not the best", text.SHORTFALL, tables.shortfall_table(outcomes)),
        part("Picks on images that they have not seen", text.UNSEEN, unseen_table(outcomes)),
        part("All five options at once", text.JOINT, tables.joint_table(findings.joints, outcomes)),
        part("One setting for several sequences", text.SEVERAL, several_table(findings.several)),
        part("How many noisy runs", text.K_DELTA + figures["k-delta"], tables.k_delta_table(findings.curves)),
        part("Noise ladder", text.LADDER + figures["noise"], tables.ladder_table(findings.ladders)),
        part("Which options matter", text.ABLATION + figures["options"], tables.ablation_table(findings.ablated)),
        part("Coverage traps", text.TRAPS, tables.trap_table(findings.traps)),
        part("Settings that lose frames or collapse", text.FRAGILE, tables.fragile_table(outcomes)),
    ]


def _introduction(findings: Findings) -> str:
    outcomes, missing = findings.outcomes, findings.missing
    confirmed = [outcome for outcome in outcomes if outcome.adopted is not None]
    adopted = [one for one in confirmed if one.adopted is not None and one.adopted.number]
    worse = [one for one in adopted if one.adopted is not None and one.change(one.adopted) > 0]
    lines = [
        "## What was measured",
        "",
        "Written by `make experiments`; every number comes from the runs. True errors are against ground truth, which "
        "neither search nor confirmation sees. GLOMAP (pycolmap), intrinsics known and fixed, one thread a run, two "
        "clean and six noisy runs a setting unless said otherwise, one option at a time, confirmations with "
        f"{CONFIRMATION_RUNS} fresh noisy runs of nominal and the best {TOP} settings. "
        f"{_frames()}",
        "",
        f"* Measured: {len(outcomes)} grids of table 2, {len(findings.many)} with many noisy runs, "
        f"{len(findings.weaker)} with weaker noise, {len(findings.ablated)} of the ablation, "
        f"{len(findings.joints)} joint searches, {len(findings.ladders)} noise ladders.",
        f"* Confirmed on fresh noise: {len(confirmed)}; adopted: {len(adopted)}; of these worse than nominal in true "
        f"ATE on the clean images: {len(worse)}{_named(worse)}.",
    ]
    if sentence := fresh_sentence(findings.fresh):
        lines.append(f"* {sentence}")
    reached, count = share_of_oracle(outcomes)
    if count:
        lines.append(
            f"* Of the oracle's gain, where it exceeds {WORTH_FINDING:.0%} ({count} grids), picks reach "
            f"{reached:.0%} on average; the aim of {AIM:.0%} is {'met' if reached >= AIM else 'missed'}. The reasons "
            "are below, grid by grid."
        )
    if sentence := noise_sentence(noise_pairs(outcomes, findings.weaker)):
        lines.append(f"* {sentence}")
    reached, count = share_of_verdicts(outcomes)
    if count:
        lines.append(
            f"* Of the {count} of these grids that are confirmed, what the confirmation took reaches {reached:.0%}."
        )
    unseen = shares([one for _, one in picks_on_unseen(outcomes)])
    if unseen.grids:
        lines.append(
            "* That oracle judges the very runs that it chooses by. On images that neither saw, where hindsight gains "
            f"more than {WORTH_FINDING:.0%} ({unseen.grids} grids), picks from half of the noisy runs reach "
            f"{unseen.by_score:.0%} of it, settings that ground truth chooses from the same noisy runs "
            f"{unseen.by_seen_truth:.0%}, and from the clean runs {unseen.by_clean_truth:.0%}."
        )
    if missing:
        lines.append(f"* Not measured yet, or without a nominal setting that works: {', '.join(missing)}.")
    return "\n".join(lines)


def _frames() -> str:
    kept = [f"{name} the first {one['max_frames']} at {one['max_image_size']} pixels" for name, one in FRAMES.items()]
    return f"All frames are used, except of {' and of '.join(kept)} on the longer side."


def _named(outcomes: Sequence[Outcome]) -> str:
    named = [_loss(outcome, outcome.adopted) for outcome in outcomes if outcome.adopted]
    return f" ({', '.join(named)})" if named else ""


def _loss(outcome: Outcome, adopted: Setting) -> str:
    truth = TRUTHS.get(outcome.experiment.sequence, UNKNOWN_TRUTH)
    loss = f"{adopted.true_ate - outcome.nominal.true_ate:.1g} {truth.unit}".rstrip()
    return (
        f"{outcome.experiment.study} {percent(outcome.change(adopted))}, that is {loss}; ground truth {truth.quality}"
    )


def _plain(value: Any) -> Any:
    return known(value) if isinstance(value, float) else value


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
                "value": setting.value,
                "feasible": setting.feasible,
                "coverage": setting.coverage,
                "true_ate": known(setting.true_ate),
                "noisy_true_ates": [known(value) for value in setting.noisy_true_ates.tolist()],
                "collapsed": setting.collapsed,
                "reprojection_px": known(setting.reprojection_px),
                "clean_clean": known(setting.clean_clean),
                "noisy_noisy": known(setting.noisy_noisy),
                "dispersion": known(setting.dispersion),
                "paired": known(setting.paired),
                "matrix": [[known(value) for value in row] for row in setting.matrix.tolist()],
            }
            for setting in outcome.settings
        ],
    }
