"""The report quotes figures that are as fresh as the experiments' own."""

import json
from pathlib import Path

from experiments.bank.bank import load
from experiments.calibration import BANK_FILE, RESULTS, TARGET, calibration

ROOT = Path(__file__).parents[2]


def test_the_packaged_calibration_is_fresh() -> None:
    fresh = calibration(load(ROOT / BANK_FILE), json.loads((ROOT / RESULTS).read_text(encoding="utf-8")))

    assert (ROOT / TARGET).read_text(encoding="utf-8") == fresh, "run: python -m experiments.calibration"
