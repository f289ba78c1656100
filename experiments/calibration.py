"""Write what a change of the score meant for the true error on the development sequences, as the report quotes it."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from experiments.bank.bank import BANK_FILE, Bank, load
from experiments.bank.draw import block, paired_ratios, run_errors
from experiments.bank.plan import SIGMAS
from gtf_tune.report.calibration import FILE, Case

RESULTS = Path("docs/results.json")
TARGET = Path("gtf_tune/report") / FILE
_DIGITS = 3


def main() -> None:
    TARGET.write_text(calibration(load(), json.loads(RESULTS.read_text(encoding="utf-8"))), encoding="utf-8")


def calibration(bank: Bank, results: dict[str, Any]) -> str:
    """Return the text of the packaged file, one case a line."""
    cases = [*confirmed_cases(results), *bank_cases(bank)]
    lines = [json.dumps([case.sequence, round(case.score, _DIGITS), round(case.true, _DIGITS)]) for case in cases]
    source = f"python -m experiments.calibration, from {RESULTS} and {BANK_FILE}"
    return f'{{"written_by": {json.dumps(source)},\n"cases": [\n' + ",\n".join(lines) + "\n]}\n"


def confirmed_cases(results: dict[str, Any]) -> Iterator[Case]:
    """Yield the candidates of confirmations: score and true error on noise that no search has seen."""
    for found in results["fresh"]:
        yield Case(found["study"].partition(".")[0], found["score"], found["change"])


def bank_cases(bank: Bank) -> Iterator[Case]:
    """Yield every configuration of the bank on every sequence that has enough runs: on the noisy copies of that."""
    for place, sequence in enumerate(bank.sequences):
        found = block(bank, place)
        if found is None:
            continue
        clean, noisy = found.clean.tolist(), found.noisy[SIGMAS[0]].tolist()
        scores = paired_ratios(run_errors(bank, place, range(found.configurations), clean, noisy))
        errors = np.log(bank.per_run["true"][place][: found.configurations][:, noisy])
        trues = np.nanmean(errors - errors[:1], axis=1)
        for score, true in zip(scores[1:].tolist(), trues[1:].tolist(), strict=True):
            if math.isfinite(score) and math.isfinite(true):
                yield Case(sequence, math.expm1(score), math.expm1(true))


if __name__ == "__main__":
    main()
