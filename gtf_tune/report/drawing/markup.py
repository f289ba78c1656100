"""HTML in which every text is escaped; only this module puts tags together."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import NewType

Html = NewType("Html", str)
_NOT_IN_AN_ID = re.compile(r"[^A-Za-z0-9._-]+")


def text(value: object) -> Html:
    """Return a text as HTML, every special character escaped."""
    return Html(escape(str(value)))


def element(tag: str, *children: Html, **attributes: str) -> Html:
    """Return an element; the attribute ``class_`` is written ``class``, and underscores inside names as hyphens."""
    named = "".join(f' {name.rstrip("_").replace("_", "-")}="{escape(value)}"' for name, value in attributes.items())
    return Html(f"<{tag}{named}>{''.join(children)}</{tag}>")


def image(source: str, description: str) -> Html:
    """Return an image that is loaded when it comes into view; ``description`` is what a screen reader says."""
    return Html(
        f'<img src="{escape(source)}" alt="{escape(description)}" title="{escape(description)}" loading="lazy">'
    )


def joined(parts: Iterable[Html]) -> Html:
    """Return the parts one after the other."""
    return Html("\n".join(parts))


def paragraph(words: object, class_: str = "") -> Html:
    """Return a paragraph of plain text."""
    return element("p", text(words), **({"class_": class_} if class_ else {}))


def missing(sentence: str) -> Html:
    """Return the sentence that stands where there is nothing to show."""
    return paragraph(sentence, "missing")


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], label: str = "") -> Html:
    """Return a table; columns whose name starts with '>' are aligned to the right; cells are plain texts or `cell`.

    ``label`` is what a screen reader calls it.
    """
    right = [name.startswith(">") for name in columns]
    head = [_cell("th", _column(name.removeprefix(">")), right[index]) for index, name in enumerate(columns)]
    body = [
        element("tr", *(_cell("td", _content(value), right[index]) for index, value in enumerate(row))) for row in rows
    ]
    inner = element("table", element("thead", element("tr", *head)), element("tbody", *body))
    # What scrolls must be reachable by the keyboard.
    return element("div", inner, class_="table", tabindex="0", role="group", aria_label=label or "Table")


class Marked(str):
    """Mark a table cell that is HTML already."""

    __slots__ = ()


def cell(markup: Html) -> Marked:
    """Return a table cell that is HTML already."""
    return Marked(markup)


def code(words: str) -> Html:
    """Return a short piece of code in a line."""
    return element("code", text(words))


def snippet(label: str, words: str) -> Html:
    """Return a block of code under its label, with a button that copies it."""
    for_screen_readers = element("span", text(f" {label}"), class_="unseen")
    words_ = element("span", text("copy"))
    button = element("button", words_, for_screen_readers, type="button", class_="copy", aria_live="polite")
    head = element("figcaption", text(label), button)
    return element("figure", head, element("pre", element("code", text(words))), class_="snippet")


def folded(summary: str, *content: Html) -> Html:
    """Return content that opens on a click."""
    return element("details", element("summary", text(summary)), *content)


def _column(name: str) -> Html:
    """Return the head of a column, its unit in brackets on a line of its own."""
    words, bracket, unit = name.partition(" [")
    return Html(text(words) + element("small", text(f"[{unit}"))) if bracket else text(name)


def _content(value: object) -> Html:
    return Html(value) if isinstance(value, Marked) else text(value)


def _cell(tag: str, content: Html, is_right: bool) -> Html:
    scope = {"scope": "col"} if tag == "th" else {}
    return element(tag, content, **scope, **({"class_": "number"} if is_right else {}))


def figure_id(name: str) -> str:
    """Return a name that is fit to be an HTML id and a file name."""
    return _NOT_IN_AN_ID.sub("-", name).strip("-")
