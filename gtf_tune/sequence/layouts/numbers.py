"""Read one number as people write it in text files."""

import math
import re

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WORDS = frozenset({"nan", "inf", "infinity"})
_SHOWN = 40


def parse_number(text: str) -> float | None:
    """Return the number that a text is, NaN and infinity included, or ``None`` where it is none.

    Unlike `float` it takes no underscores, no foreign digits and no words but these. What is too large for a float is
    infinite.
    """
    plain = text.strip()
    if _NUMBER.fullmatch(plain) or plain.lstrip("+-").lower() in _WORDS:
        return float(plain)
    return None


def parse_finite(text: str) -> float | None:
    """Return the finite number that a text is, or ``None``."""
    number = parse_number(text)
    return number if number is not None and math.isfinite(number) else None


def shortened(text: str) -> str:
    """Return a text for a message, cut where it is long."""
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
