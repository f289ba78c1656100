"""Fill the bank of runs, pack it into one small file, and replay rules on it."""

import argparse
import json
import os
import sys
from pathlib import Path

from gtf_tune.errors import GtfTuneError

WORK_VARIABLE = "GTF_TUNE_BANK"
PAGE = Path("docs/bank.md")
ANSWER = Path("docs/which-options.md")
RESULTS = Path("docs/results.md")
CONFIRMED = Path("docs/results.json")


def main() -> None:
    arguments = _arguments()
    arguments.work = (arguments.work or Path(os.environ.get(WORK_VARIABLE, "storage/data/bank"))).absolute()
    try:
        {"fill": _fill, "pack": _pack, "replay": _replay}[arguments.command](arguments)
    except GtfTuneError as error:
        sys.exit(str(error))


def _fill(arguments: argparse.Namespace) -> None:
    from experiments.bank.fill import Depot, data_folder, fill, write_line

    fill(Depot(arguments.work, data_folder(arguments.data)), arguments.minutes, write_line)


def _pack(arguments: argparse.Namespace) -> None:
    from experiments.bank.bank import BANK_FILE
    from experiments.bank.fill import Depot, data_folder
    from experiments.bank.pack import pack, without_unrun

    without_unrun(pack(Depot(arguments.work, data_folder(arguments.data)))).save(BANK_FILE)


def _replay(arguments: argparse.Namespace) -> None:
    from experiments.bank.bank import BANK_FILE, load
    from experiments.bank.page import page, with_short_answer
    from experiments.bank.replay import replay
    from experiments.bank.results import results_page
    from experiments.bank.rules import RULES
    from experiments.calibration import main as calibrate

    del arguments
    if not BANK_FILE.exists():
        sys.exit(f"there is no {BANK_FILE}; run `python -m experiments.bank fill` and then `pack`")
    bank = load()
    ANSWER.write_text(with_short_answer(ANSWER.read_text(encoding="utf-8"), bank), encoding="utf-8")
    found = replay(bank, RULES)
    PAGE.write_text(page(bank, found), encoding="utf-8")
    fresh = json.loads(CONFIRMED.read_text(encoding="utf-8"))["fresh"]
    RESULTS.write_text(results_page(bank, found, fresh), encoding="utf-8")
    calibrate()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m experiments.bank", description=__doc__)
    parser.add_argument("--work", type=Path, help=f"folder of the runs themselves (default: ${WORK_VARIABLE})")
    parser.add_argument("--data", type=Path, help="folder of the real sequences (default: $GTF_TUNE_DATA)")
    commands = parser.add_subparsers(dest="command", required=True)
    filling = commands.add_parser("fill", help="make runs that are not stored yet; resumable")
    filling.add_argument("--minutes", type=float, default=1e6, help="stop after so many minutes")
    commands.add_parser("pack", help="write the runs that are stored into one small file of the repository")
    commands.add_parser("replay", help=f"replay all rules on that file and write {PAGE}, {RESULTS} and {ANSWER}")
    return parser.parse_args()


if __name__ == "__main__":
    main()
