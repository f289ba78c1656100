"""Read single values from the text of settings files."""

import json
import re

_WHOLE = re.compile(r"[-+]?[0-9]+")
_BOOLEANS = {"true": True, "false": False}


def read_scalar(text: str) -> bool | int | float | str:
    """Return the value that a text without comment stands for; what is nothing else is a text."""
    if text[:1] in ('"', "'") and text[-1:] == text[0]:
        return _unquoted(text)
    if _WHOLE.fullmatch(text):
        return int(text)
    try:
        return float(text)
    except ValueError:
        return _BOOLEANS.get(text.lower(), text)


def _unquoted(text: str) -> str:
    if text[0] == "'":
        return text[1:-1].replace("''", "'")
    try:
        return str(json.loads(text))
    except json.JSONDecodeError:
        return text[1:-1]
