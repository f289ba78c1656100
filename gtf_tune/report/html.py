"""The page of a report: one HTML file that needs no network and no server."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files

from plotly.offline import get_plotlyjs

from gtf_tune.report.drawing import markup
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Drawing

_NOT_IN_AN_ID = re.compile(r"[^A-Za-z0-9._-]+")


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
    script = f"<script>{get_plotlyjs()}</script><script>{_resource('page.js')}</script>"
    body = markup.joined([_header(head), _contents(sections), *map(_section, sections), _footer(head)])
    head_ = f"<head>{meta}{title}{style}</head>"
    return f'<!DOCTYPE html>\n<html lang="en">{head_}\n<body>\n{body}\n{script}\n</body></html>\n'


def figure_id(name: str) -> str:
    """Return a name that is fit to be an HTML id and a file name."""
    return _NOT_IN_AN_ID.sub("-", name).strip("-")


def figure_json(figure: object) -> str:
    """Return the JSON of a figure in a form that can stand inside a script element."""
    content = json.loads(figure.to_json())  # type: ignore[attr-defined]
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


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
    return markup.element("nav", *links)


def _section(section: Section) -> Html:
    parts = [markup.element("h2", markup.text(section.title))]
    if section.text:
        parts.append(markup.paragraph(section.text, "lead"))
    for group in _grouped(section.blocks):
        parts.append(_grid(group) if isinstance(group, list) else group)
    return markup.element("section", *parts, id=section.kind)


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
    title = [markup.element("h4", markup.text(drawing.title))] if drawing.title else []
    plot = markup.element("div", id=name, class_="plot", style=f"height:{height}px", data_spec=f"{name}.json")
    # JSON with every '<' written as \\u003c cannot end the element.
    spec = Html(f'<script type="application/json" id="{name}.json">{figure_json(drawing.figure)}</script>')
    return markup.element("div", *title, plot, spec, class_="card wide" if drawing.is_wide else "card")


def _footer(head: PageHead) -> Html:
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return markup.element("footer", markup.text(f"Written by gtf-tune {head.version} on {now}"))


def _resource(name: str) -> str:
    return (files("gtf_tune.report") / name).read_text(encoding="utf-8")
