"""Write docs/paper.md: the paper's figures and numbers beside ours, at most two pages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go

from benchmarks.drawing import write_svgs
from experiments.numbers import mean, percent, plain, significant
from experiments.paper import figures
from experiments.paper.figures import PICK, Linearity
from experiments.paper.numbers import ROWS
from experiments.paper.plan import COLMAPS_HUBER, PAPERS_HUBER, PaperStudy, stands_for
from experiments.plan import OPTIONS
from experiments.settings import PREDICTORS, Outcome

DOCS = Path("docs")
IMAGES = "images/paper"

_HEAD = """# The paper, here

Written by `make paper`; every number of ours comes from its runs, every number of the paper from its table."""
_LIGHT = (
    "**Light form.** Without `DATA=DIR`, the folder of the paper's data sets, three rendered sequences of 50 frames of "
    "256 x 192 pixels at 3 Hz stand in: *office* (a walk past furniture) for Replica's office 0, *outdoor* (a walk "
    "straight on in changing light) for TartanAir ME001, *plain* (little texture) for ETH3D table_3. Grids are thinned "
    "to 2 or 3 values beside nominal, there are 1 clean and 3 noisy runs (12 for the figure on k_delta), noise of 5 "
    "grey levels is common to all values, and an image has at most 200 features. Score and baseline are the paper's: "
    "mean, not normalised, Huber loss of 0.1 as nominal."
)
_FULL = "The paper's own sequences, with grids thinned as `POINTS` says (12 by default; the paper has up to 100)."


@dataclass(frozen=True)
class Paper:
    """What was measured, of which studies, and whether in the light form."""

    outcomes: Sequence[Outcome]
    planned: Sequence[PaperStudy]
    linearity: Linearity | None
    is_light: bool

    def of(self, figure: str) -> list[Outcome]:
        """Return the finished studies of a figure."""
        return [
            one for one in self.outcomes if isinstance(one.experiment, PaperStudy) and one.experiment.figure == figure
        ]

    def of_option(self, short: str) -> list[Outcome]:
        """Return the finished studies of the table over one option."""
        return [one for one in self.of("table") if one.experiment.option.short == short]


def write_page(paper: Paper, docs: Path = DOCS) -> None:
    """Write the page and its figures as far as there is anything."""
    drawn: dict[str, go.Figure] = {name: draw(paper) for name, (draw, _) in _FIGURES.items()}
    known = [name for name, figure in drawn.items() if figure.data]
    if known:
        write_svgs({name: drawn[name] for name in known}, docs / IMAGES)
    (docs / "paper.md").write_text(page(paper, known), encoding="utf-8")


def page(paper: Paper, drawn: Sequence[str]) -> str:
    """Return the text of the page; ``drawn`` are the names of the figures that exist."""
    counted = f"{len(paper.outcomes)} of {len(paper.planned)} studies are measured."
    parts = [_HEAD, f"{_LIGHT if paper.is_light else _FULL} {counted}", "## Table 2", _table(paper), summary(paper)]
    reasons = reason_lines(paper)
    if reasons:
        parts += ["## Why they differ", "\n".join(f"* {line}" for line in reasons)]
    parts += ["## Figures"] if drawn else []
    parts += [f"![{words}]({IMAGES}/{name}.svg)\n\n*{words}*" for name, (_, words) in _FIGURES.items() if name in drawn]
    return "\n\n".join(parts) + "\n"


def _table(paper: Paper) -> str:
    rows = [
        ["sequence", "nominal", *(option.paper_column for option in OPTIONS.values())],
        ["---"] * (2 + len(OPTIONS)),
    ]
    for printed in ROWS:
        cells = [f"{-gtf:+.1f}% ({-truth:+.1f}%)" for gtf, truth in (printed.improvements[short] for short in OPTIONS)]
        rows.append([f"paper: {printed.sequence}", printed.nominal, *cells])
        for name in dict.fromkeys(study.sequence for study in paper.planned if study.figure == "table"):
            if stands_for(name, printed.sequence):
                rows.append(_own_row(paper, name))
    text = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    return f"Change of the true ATE at the value that GTF ATE picks (at the best value), against nominal.\n\n{text}"


def _own_row(paper: Paper, sequence: str) -> list[str]:
    mine = {one.experiment.option.short: one for one in paper.of("table") if one.experiment.sequence == sequence}
    nominal = next((significant(one.nominal.true_ate) for one in mine.values()), "-")
    cells = [_own_cell(mine[short]) if short in mine else "not yet" for short in OPTIONS]
    return [f"here: {sequence}", nominal, *cells]


def _own_cell(outcome: Outcome) -> str:
    pick = outcome.agreement(PICK).pick
    return f"{percent(outcome.change(pick))} ({percent(outcome.change(outcome.oracle))})"


def summary(paper: Paper) -> str:
    """Return in a sentence how often picks improve, and by how much, in the paper and here."""
    cells = [cell for row in ROWS for cell in row.improvements.values()]
    printed = f"The paper improves {sum(gtf > 0 for gtf, _ in cells)} of {len(cells)}"
    printed += f", by {mean(gtf for gtf, _ in cells):.0f} % of {mean(truth for _, truth in cells):.0f} % on average."
    table = paper.of("table")
    if not table:
        return f"{printed} Here nothing is measured yet."
    changes = [one.change(one.agreement(PICK).pick) for one in table]
    best = [one.change(one.oracle) for one in table]
    worse = sum(change > 0 for change in changes)
    return (
        f"{printed} Here {sum(change < 0 for change in changes)} of {len(table)} improve and {worse} are worse; "
        f"{percent(mean(changes))} of {percent(mean(best))} on average (negative is better)."
    )


def reason_lines(paper: Paper) -> list[str]:
    """Return what each reason for a difference from the paper is worth, as far as it was measured."""
    return [line for line in (_baseline(paper), _noise(paper), _mean_or_median(paper)) if line]


def _baseline(paper: Paper) -> str:
    """Return how much of the gain on Huber is a return from COLMAP's default to the paper's."""
    found = []
    for one in paper.of_option("huber"):
        colmaps = next((setting for setting in one.feasible if setting.value == COLMAPS_HUBER), None)
        if colmaps is not None:
            pick = one.agreement(PICK).pick
            found.append((pick.true_ate / colmaps.true_ate - 1, one.nominal.true_ate / colmaps.true_ate - 1))
    if not found:
        return ""
    return (
        f"**Baseline.** Against COLMAP 4's Huber loss of {COLMAPS_HUBER:g} the picks change the true ATE by "
        f"{percent(mean(gain for gain, _ in found))} on average over {len(found)} sequences; the paper's "
        f"{PAPERS_HUBER:g} alone does so by {percent(mean(usual for _, usual in found))}."
    )


def _noise(paper: Paper) -> str:
    found = sorted([*paper.of("noise"), *_same_as_noise(paper)], key=lambda one: one.experiment.sigma)
    if len(found) < 2:
        return ""
    said = [f"{one.experiment.sigma:g}: {percent(one.change(one.agreement(PICK).pick))}" for one in found]
    return f"**Noise.** Change at the pick by grey levels of noise, same option and images: {', '.join(said)}."


def _mean_or_median(paper: Paper) -> str:
    table = paper.of("table")
    if not table:
        return ""
    said = []
    for name in ("mean", "median"):
        agreements = [one.agreement(PREDICTORS[name]) for one in table]
        changes = [one.change(found.pick) for one, found in zip(table, agreements, strict=True)]
        r_squared = mean(found.r_squared for found in agreements)
        said.append(f"{name} {percent(mean(changes))} (R2 with the true ATE {plain(r_squared)})")
    return f"**Mean or median.** Change at the pick on average over {len(table)} studies: {', '.join(said)}."


def _same_as_noise(paper: Paper) -> list[Outcome]:
    """Return the study of the table that continues the figure on noise: the same option and sequence."""
    of_noise = [study for study in paper.planned if study.figure == "noise"]
    return [
        one
        for one in paper.of("table")
        if any((one.experiment.sequence, one.experiment.option.name) == (s.sequence, s.option.name) for s in of_noise)
    ]


_FIGURES: dict[str, tuple[Callable[[Paper], go.Figure], str]] = {
    "linearity": (
        lambda paper: figures.linearity(paper.linearity),
        "True ATE of the noisy runs over the noise, with the line through the first values.",
    ),
    "noise": (
        lambda paper: figures.noise([*paper.of("noise"), *_same_as_noise(paper)]),
        "True ATE at the pick over the noise magnitude, one option.",
    ),
    "k-delta": (
        lambda paper: figures.k_delta(paper.of("k-delta")),
        "R2 between score and true ATE over the number of noisy runs, resampled from one study.",
    ),
    "regressions": (
        lambda paper: figures.regressions(paper.of_option("ba")),
        "Score and reprojection error over the option, and their regressions with the true ATE.",
    ),
    "ablation": (
        lambda paper: figures.ablation([*paper.of("ablation"), *_first_of_table(paper)]),
        "Range of the true ATE over each option, one at a time.",
    ),
}


def _first_of_table(paper: Paper) -> list[Outcome]:
    """Return the studies of the table on the sequence of the ablation, once that has begun."""
    names = {one.experiment.sequence for one in paper.of("ablation")}
    return [one for one in paper.of("table") if one.experiment.sequence in names]
