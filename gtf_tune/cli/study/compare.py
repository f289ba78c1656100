"""Put several studies side by side."""

from typing import Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, open_storage
from gtf_tune.cli.terminal.console import percent, write_json, write_line, write_table


def compare(
    names: Annotated[list[str], typer.Argument(metavar="STUDY...", help="Names of studies.")],
    by: Annotated[
        str, typer.Option("--by", metavar="WHAT", help="Sort by noise_sigma, noisy_runs, option or sequence.")
    ] = "",
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Put studies side by side: what each picked, and what ground truth says of it where there is any.

    The pick is the feasible trial with the lowest score, whatever a confirmation said of it. Changes are relative to
    nominal; "best possible" is what ground truth itself would have picked. --json has the errors too.

    Example: gtf-tune study compare sigma-02 sigma-05 sigma-10 --by noise_sigma
    """
    from gtf_tune.study.ground_truth.comparison import compare_studies

    found = compare_studies(open_storage(storage), names, by)
    if json:
        write_json(
            {
                "studies": [row.as_json() for row in found.rows],
                "improved": found.improved,
                "judged": len(found.judged),
                "mean_change": found.mean_change if found.judged else None,
                "mean_best_change": found.mean_best_change if found.judged else None,
            }
        )
        return
    several = len({row.study for row in found.rows}) < len(found.rows)
    columns = [*([by.replace("_", " ")] if by else []), "study", *(["sequence"] if several else []), "pick", ">score"]
    columns += [">truth", ">best possible"] if found.judged else []
    rows = []
    for row in found.rows:
        names_ = (*((row.by,) if by else ()), row.study, *((row.sequence,) if several else ()))
        judged = (percent(row.true_change), percent(row.best_change)) if found.judged else ()
        rows.append((*names_, row.pick_text, percent(row.score_change), *judged))
    write_table([*columns, "verdict"], [(*cells, row.decision) for cells, row in zip(rows, found.rows, strict=True)])
    write_line(found.sentence)
