"""Draw the paper's figures from studies measured here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from experiments.figures import options as options_figure
from experiments.findings import Findings
from experiments.k_delta import r_squared_by_count
from experiments.numbers import mean
from experiments.settings import PREDICTORS, Outcome
from gtf_tune.errors import TrajectoryError
from gtf_tune.metrics import ate
from gtf_tune.report.drawing import theme
from gtf_tune.study.noise.ladder import NoiseScale
from gtf_tune.trajectory import FloatArray, Trajectory

PICK = PREDICTORS["mean"]
"""The paper's score: the mean over all pairs."""

_FIRST_LEVELS = 3


@dataclass(frozen=True, eq=False)
class Linearity:
    """Score and true ATE over the noise in grey levels, without noise first; NaN where nothing is known."""

    sigmas: FloatArray
    scores: FloatArray
    true_ates: FloatArray

    @property
    def line(self) -> tuple[float, float]:
        """Slope and intercept of the line through the true ATEs of the first levels."""
        slope, intercept = np.polyfit(self.sigmas[:_FIRST_LEVELS], self.true_ates[:_FIRST_LEVELS], 1)
        return float(slope), float(intercept)


def linearity_of(scale: NoiseScale, truth: Trajectory, seen: Sequence[Sequence[Trajectory]]) -> Linearity:
    """Return the linearity of a ladder; ``seen`` are the runs of each level, those without noise first."""
    levels = [scale.floor, *scale.levels]
    return Linearity(
        np.array([level.sigma for level in levels]),
        np.array([level.score for level in levels]),
        np.array([mean(_true_ates(truth, runs)) for runs in seen]),
    )


def _true_ates(truth: Trajectory, runs: Sequence[Trajectory]) -> list[float]:
    found = []
    for run in runs:
        try:
            found.append(ate(truth, run, alignment="sim3"))
        except TrajectoryError:
            found.append(float("nan"))
    return found


def linearity(found: Linearity | None) -> go.Figure:
    """Draw the true ATE over the noise with the line through the first values (the paper's figure on linearity)."""
    figure = theme.figure()
    if found is None:
        return figure
    slope, intercept = found.line
    ends = [0.0, float(found.sigmas.max())]
    figure.add_scatter(
        x=found.sigmas, y=found.true_ates, mode="markers", name="true ATE", marker=_dot(theme.GROUND_TRUTH)
    )
    line = {"color": theme.GROUND_TRUTH, "dash": "dash"}
    lined = [intercept + slope * end for end in ends]
    figure.add_scatter(x=ends, y=lined, mode="lines", name="line through the first values", line=line)
    figure.update_xaxes(**theme.axis("noise [grey levels]"))
    figure.update_yaxes(**theme.axis("true ATE", rangemode="tozero"))
    return figure


def noise(outcomes: Sequence[Outcome]) -> go.Figure:
    """Draw the true ATE at the pick over the noise magnitude, beside nominal's and the best possible."""
    figure = theme.figure()
    ranked = sorted(outcomes, key=lambda outcome: outcome.experiment.sigma)
    lines = {
        "nominal": ([one.nominal.true_ate for one in ranked], theme.NOMINAL),
        "picked by GTF ATE": ([one.agreement(PICK).pick.true_ate for one in ranked], theme.GTF_DARK),
        "best by ground truth": ([one.oracle.true_ate for one in ranked], theme.GROUND_TRUTH),
    }
    for label, (values, colour) in lines.items() if ranked else ():
        sigmas = [one.experiment.sigma for one in ranked]
        figure.add_scatter(x=sigmas, y=values, name=label, mode="lines+markers", line={"color": colour})
    figure.update_xaxes(**theme.axis("noise [grey levels]", type="log"))
    figure.update_yaxes(**theme.axis("true ATE", rangemode="tozero"))
    return figure


def k_delta(outcomes: Sequence[Outcome]) -> go.Figure:
    """Draw R2 between score and true ATE over the number of noisy runs, resampled from those of one study."""
    figure = theme.figure()
    for outcome in outcomes:
        counts = range(1, outcome.nominal.matrix.shape[1] + 1)
        for name, dash in (("mean", "solid"), ("median", "dot")):
            values = r_squared_by_count(outcome, name, counts)  # type: ignore[arg-type]
            line = {"color": theme.GTF_DARK, "dash": dash}
            figure.add_scatter(x=list(counts), y=values, name=f"{outcome.experiment.sequence}, {name}", line=line)
    figure.update_xaxes(**theme.axis("noisy runs (k_delta)"))
    figure.update_yaxes(**theme.axis("R2 with the true ATE", range=[0, 1.02]))
    return figure


def regressions(outcomes: Sequence[Outcome]) -> go.Figure:
    """Draw score and reprojection error over the option, and both against the true ATE with their lines."""
    drawn = theme.figure(420)
    if not outcomes:
        return drawn
    outcome = outcomes[0]
    ranked = sorted(outcome.feasible, key=lambda setting: setting.value)
    truth = [setting.true_ate for setting in ranked]
    kinds = {
        "GTF ATE": ([PICK(setting) for setting in ranked], theme.GTF_DARK),
        "reprojection error [px]": ([setting.reprojection_px for setting in ranked], theme.REPROJECTION),
    }
    figure = make_subplots(rows=1, cols=3, horizontal_spacing=0.09)
    values = [setting.value for setting in ranked]
    shown = {"true ATE": (truth, theme.GROUND_TRUTH), **kinds}
    for label, (numbers, colour) in shown.items():
        usual = numbers[ranked.index(outcome.nominal)]
        relative = [number / usual for number in numbers]
        figure.add_scatter(x=values, y=relative, name=label, line={"color": colour}, row=1, col=1)
    for column, (label, (numbers, colour)) in enumerate(kinds.items(), start=2):
        slope, intercept = np.polyfit(numbers, truth, 1) if len(set(numbers)) > 1 else (0.0, float(np.mean(truth)))
        ends = [min(numbers), max(numbers)]
        figure.add_scatter(x=numbers, y=truth, mode="markers", marker=_dot(colour), showlegend=False, row=1, col=column)
        lined = [intercept + slope * end for end in ends]
        figure.add_scatter(x=ends, y=lined, mode="lines", line={"color": colour}, showlegend=False, row=1, col=column)
        figure.update_xaxes(title_text=label, row=1, col=column)
        figure.update_yaxes(title_text="true ATE", row=1, col=column)
    figure.update_xaxes(type="log", title_text=outcome.experiment.option.name.rpartition(".")[2], row=1, col=1)
    figure.update_yaxes(title_text="relative to nominal", row=1, col=1)
    figure.update_layout(template=drawn.layout.template, height=420, legend={"orientation": "h", "y": 1.15})
    return figure


def ablation(outcomes: Sequence[Outcome]) -> go.Figure:
    """Draw the range of the true ATE over the values of each option."""
    return options_figure(Findings([], [], [], [], outcomes, [], [], []))


def _dot(colour: str) -> Mapping[str, object]:
    return {"color": colour, "size": 9}
