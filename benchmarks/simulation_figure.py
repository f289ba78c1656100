"""Draw how often the 95 % intervals hold the truth, without and with collapsed runs."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from benchmarks.interval_coverage import NOISY_RUNS
from gtf_tune.report.drawing import theme

_COLOURS = MappingProxyType(
    {"mean": theme.REPROJECTION, "median": theme.GTF_DARK, "gmean": theme.NOMINAL, "trimmed": theme.GROUND_TRUTH}
)
_WANTED = 0.95


def draw_coverage(records: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Return one panel for each share of collapsed runs; clean runs agree as they do in GLOMAP studies."""
    clean = min(record["clean_spread"] for record in records)
    shares = sorted({record["collapse"] for record in records})
    titles = [f"{share:.0%} of noisy runs collapse" for share in shares]
    figure = make_subplots(cols=len(shares), subplot_titles=titles, shared_yaxes=True, horizontal_spacing=0.04)
    figure.update_layout({**theme.figure().layout.to_plotly_json(), "margin": {"l": 60, "r": 20, "t": 80, "b": 55}})
    figure.update_layout(legend={"y": 1.12})
    for record in records:
        if record["clean_spread"] == clean:
            figure.add_trace(
                go.Scatter(
                    x=list(NOISY_RUNS),
                    y=[100 * record[f"kd={count}"] for count in NOISY_RUNS],
                    name=record["aggregate"],
                    line={"color": _COLOURS[record["aggregate"]]},
                    showlegend=record["collapse"] == shares[0],
                ),
                row=1,
                col=shares.index(record["collapse"]) + 1,
            )
    figure.add_hline(y=100 * _WANTED, line={"color": theme.INK, "dash": "dash", "width": 1})
    figure.update_xaxes(**theme.axis("noisy runs (k_delta)", tickvals=list(NOISY_RUNS)))
    figure.update_yaxes(**theme.axis(range=[0, 102]))
    figure.update_yaxes(title_text="intervals that hold the truth [%]", col=1)
    return figure
