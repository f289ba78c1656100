"""The page of a report: one HTML file that needs no network and no server."""

import base64
import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any

from plotly.offline import get_plotlyjs

from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.description import description
from gtf_tune.report.drawing.markup import Html, figure_id
from gtf_tune.report.panels.base import Block, Drawing

_DIGITS = 6
_TOO_OLD = "This browser is too old to draw the figures: it cannot unpack them. Texts and tables are complete."
_NO_SCRIPT = "Figures need JavaScript. Texts and tables are complete."


@dataclass(frozen=True, eq=False)
class Section:
    """One panel that is ready to be shown."""

    kind: str
    title: str
    text: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class PageHead:
    """The top of a report; ``facts`` are short texts in one line."""

    title: str
    study: str
    facts: tuple[str, ...]
    version: str


def render_page(head: PageHead, sections: Sequence[Section]) -> str:
    """Return the whole page; plotly.js is inside once, figures are drawn when they come into view."""
    title = markup.element("title", markup.text(f"{head.study}: {head.title}"))
    meta = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    style = f"<style>{_resource('style.css')}</style>"
    main = markup.element("main", *map(_section, sections))
    body = markup.joined([_skip_link(sections), _header(head), _contents(sections), *_notices(), main, _footer(head)])
    head_ = f"<head>{meta}{title}{style}</head>"
    return f'<!DOCTYPE html>\n<html lang="en">{head_}\n<body>\n{body}\n{_scripts()}\n</body></html>\n'


def figure_json(figure: object) -> str:
    """Return the JSON of a figure in a form that can stand inside a script element."""
    content = _rounded(json.loads(figure.to_json()))  # type: ignore[attr-defined]
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


def _rounded(content: Any) -> Any:
    """Return JSON with six digits of every number, which is more than a screen shows."""
    if isinstance(content, float):
        return float(f"{content:.{_DIGITS}g}")
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    if isinstance(content, dict):
        return {name: _rounded(value) for name, value in content.items()}
    return content


def _scripts() -> Html:
    """Return plotly.js, packed because it makes up most of the page, and the script that draws the figures."""
    packed = base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()
    return Html(
        f'<script type="application/json" id="dark-colours">{json.dumps(dict(theme.DARK))}</script>\n'
        f'<script type="text/plain" id="plotly">{packed}</script>\n'
        f"<script>{_resource('page.js')}</script>"
    )


def _notices() -> list[Html]:
    too_old = markup.element("p", markup.text(_TOO_OLD), class_="missing", id="too-old", hidden="")
    return [markup.element("noscript", markup.missing(_NO_SCRIPT)), too_old]


def _skip_link(sections: Sequence[Section]) -> Html:
    first = sections[0]
    return markup.element("a", markup.text(f"Skip to: {first.title}"), href=f"#{first.kind}", class_="skip")


def _header(head: PageHead) -> Html:
    return markup.element(
        "header",
        markup.element("p", markup.text(head.title), class_="kicker"),
        markup.element("h1", markup.text(head.study)),
        markup.element("p", markup.text(" · ".join(head.facts)), class_="facts-line"),
    )


def _contents(sections: Sequence[Section]) -> Html:
    links = [
        markup.element("a", markup.text(section.kind.capitalize()), href=f"#{section.kind}") for section in sections
    ]
    return markup.element("nav", *links, aria_label="Panels")


def _section(section: Section) -> Html:
    title = f"{section.kind}-title"
    parts = [markup.element("h2", markup.text(section.title), id=title)]
    if section.text:
        parts.append(markup.paragraph(section.text, "lead"))
    for group in _grouped(section.blocks):
        parts.append(_grid(group) if isinstance(group, list) else group)
    return markup.element("section", *parts, id=section.kind, aria_labelledby=title)


def _grouped(blocks: Sequence[Block]) -> list[Html | list[Drawing]]:
    """Return the blocks with neighbouring drawings gathered into one grid."""
    groups: list[Html | list[Drawing]] = []
    for block in blocks:
        if not isinstance(block, Drawing):
            groups.append(block)
        elif groups and isinstance(groups[-1], list):
            groups[-1].append(block)
        else:
            groups.append([block])
    return groups


def _grid(drawings: Sequence[Drawing]) -> Html:
    columns = "grid single" if len(drawings) == 1 else "grid thirds" if len(drawings) == 3 else "grid"
    return markup.element("div", *(_figure(drawing) for drawing in drawings), class_=columns)


def _figure(drawing: Drawing) -> Html:
    name = figure_id(drawing.name)
    height = drawing.figure.layout.height
    title = [markup.element("figcaption", markup.text(drawing.title))] if drawing.title else []
    plot = markup.element(
        "div",
        id=name,
        class_="plot",
        style=f"height:{height}px",
        data_spec=f"{name}.json",
        role="group",
        aria_label=description(drawing),
    )
    # JSON with every '<' written as \\u003c cannot end the element.
    spec = Html(f'<script type="application/json" id="{name}.json">{figure_json(drawing.figure)}</script>')
    return markup.element("figure", *title, plot, spec, class_="card wide" if drawing.is_wide else "card")


def _footer(head: PageHead) -> Html:
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return markup.element("footer", markup.text(f"Written by gtf-tune {head.version} on {now}"))


def _resource(name: str) -> str:
    return (files("gtf_tune.report") / name).read_text(encoding="utf-8")
