"""Run the benchmarks, print their tables, and write docs/performance.md.

::

    python -m benchmarks                       # all, quick
    python -m benchmarks --full                # all, as for the documentation
    python -m benchmarks --only overhead jobs  # some; the others keep their last results
    python -m benchmarks --render              # only write the page from the last results
"""

import argparse
import json
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from benchmarks import (
    cached_studies,
    five_rendered,
    machine,
    many_trials,
    numerics,
    overhead,
    page,
    search_runs,
    side_by_side,
    verdict_price,
)
from benchmarks.section import Benchmark, Effort, as_text

BENCHMARKS: Mapping[str, Benchmark] = {
    "metric": numerics.run_metric,
    "noise": numerics.run_noise,
    "cache": cached_studies.run,
    "overhead": overhead.run,
    "jobs": side_by_side.run,
    "search": search_runs.run,
    "five-rendered": five_rendered.run,
    "many-trials": many_trials.run,
    "verdict": verdict_price.run,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="more rounds, seeds and images")
    parser.add_argument("--only", nargs="+", choices=list(BENCHMARKS), default=list(BENCHMARKS), metavar="NAME")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the tables here too")
    parser.add_argument("--render", action="store_true", help="measure nothing, write the page")
    arguments = parser.parse_args()
    results = page.load()
    for name in [] if arguments.render else arguments.only:
        results[name] = _measure(name, Effort(arguments.full))
        print(as_text(results[name].section), flush=True)
        page.save({one: results[one] for one in BENCHMARKS if one in results})
    page.save({one: results[one] for one in BENCHMARKS if one in results})
    if arguments.json:
        tables = {name: results[name].section.as_dict() for name in arguments.only if name in results}
        arguments.json.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")


def _measure(name: str, effort: Effort) -> page.Result:
    facts = machine.describe()
    began = time.perf_counter()
    section = BENCHMARKS[name](effort)
    return page.Result(
        section=section,
        machine=facts,
        measured_at=datetime.now(UTC).strftime("%Y-%m-%d"),
        full=effort.full,
        took_s=time.perf_counter() - began,
    )


if __name__ == "__main__":
    main()
