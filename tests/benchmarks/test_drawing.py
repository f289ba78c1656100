import importlib.util
import shutil
from pathlib import Path

import plotly.graph_objects as go
import pytest

from benchmarks.drawing import WIDTH_PX, without_chance, write_svgs


def test_the_random_name_of_a_drawing_gives_way_to_its_own() -> None:
    svg = '<svg><defs id="defs-4d362c"><clipPath id="clip4d362cxy"/></defs><g clip-path="url(#clip4d362cxy)"/></svg>'

    assert without_chance(svg, "gains") == svg.replace("4d362c", "gains")


def test_a_drawing_without_one_stays_as_it_is() -> None:
    assert without_chance("<svg/>", "gains") == "<svg/>"


@pytest.mark.skipif(
    importlib.util.find_spec("kaleido") is None or not shutil.which("chromium"), reason="kaleido or Chromium is missing"
)
def test_figures_are_written_at_the_height_that_they_ask_for(tmp_path: Path) -> None:
    figures = {f"of-{height}": go.Figure(go.Scatter(y=[1, 2]), {"height": height}) for height in (300, 780)}

    names = write_svgs({**figures, "empty": go.Figure()}, tmp_path)

    assert names == ["of-300", "of-780"]
    for height in (300, 780):
        assert f'width="{WIDTH_PX}" height="{height}"' in (tmp_path / f"of-{height}.svg").read_text()[:300]
