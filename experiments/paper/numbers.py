"""The paper's numbers for GLOMAP (table "GLOMAP", arXiv 2412.01116): changes of the true ATE in per cent."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperRow:
    """One sequence: its nominal ATE as printed, and for each option the improvement by GTF and by ground truth."""

    sequence: str
    nominal: str
    improvements: dict[str, tuple[float, float]]


ROWS = (
    PaperRow(
        "Replica office0",
        "1.35 mm",
        {
            "peak": (66.2, 71.5),
            "ba": (40.6, 40.6),
            "huber": (39.3, 40.2),
            "ratio": (7.1, 11.0),
            "twoview": (40.1, 45.2),
        },
    ),
    PaperRow(
        "TartanAir ME001",
        "4.72 cm",
        {
            "peak": (13.0, 13.0),
            "ba": (46.2, 52.9),
            "huber": (51.1, 55.8),
            "ratio": (23.1, 27.8),
            "twoview": (33.0, 51.5),
        },
    ),
    PaperRow(
        "ETH3D table_3",
        "2.39 mm",
        {
            "peak": (12.9, 12.9),
            "ba": (16.2, 16.2),
            "huber": (15.9, 17.1),
            "ratio": (-18.5, 9.1),
            "twoview": (3.7, 16.3),
        },
    ),
)
