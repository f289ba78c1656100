"""Whatever shows a study says the same about which trial to use."""

import html
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
import optuna_dashboard
import pytest
from sqlalchemy import update

from gtf_tune.report.dashboard.sync import DashboardSync
from gtf_tune.report.dashboard.writer import artifact_folder
from gtf_tune.report.panels.options import recommended_star
from gtf_tune.report.study_data import read_search
from gtf_tune.store import confirmations, studies, trials
from gtf_tune.store.database import Database, models, open_database
from gtf_tune.store.database.session import write
from gtf_tune.store.optuna.tables import optuna_storage
from tests.cli.conftest import Cli, Said, cli  # noqa: F401 (a fixture)
from tests.report.conftest import BEST, OPTIONS

OTHER = 4
NEITHER = "Neither the nominal options nor others are recommended"
UNCONFIRMED = f"Trial {BEST} is the best so far; not confirmed yet"


@dataclass(frozen=True)
class Case:
    """A study, whether its nominal trial works, how its confirmation ended, and what is to be said then."""

    study: str
    confirmation: str | None
    headline: str
    recommended: int | None
    adopted: int | None = None
    nominal_works: bool = True
    decision: str = ""


CASES = {
    "unconfirmed": Case("synthetic", None, UNCONFIRMED, BEST, decision="unconfirmed"),
    "adopt": Case("synthetic", "adopt", f"Adopt the options of trial {BEST}", BEST, adopted=BEST, decision="adopt"),
    "adopt another than the luckiest": Case(
        "synthetic", "adopt", f"Adopt the options of trial {OTHER}", OTHER, adopted=OTHER, decision="adopt"
    ),
    "keep": Case("synthetic", "keep nominal", "Keep the nominal options", 0, decision="keep nominal"),
    "no verdict": Case("synthetic", "none", NEITHER, None, decision="neither"),
    "infeasible nominal, unconfirmed": Case(
        "synthetic", None, UNCONFIRMED, BEST, nominal_works=False, decision="unconfirmed"
    ),
    "infeasible nominal, keep": Case(
        "synthetic", "keep nominal", NEITHER, None, nominal_works=False, decision="neither"
    ),
    "infeasible nominal, adopt": Case(
        "synthetic",
        "adopt",
        f"Adopt the options of trial {BEST}",
        BEST,
        adopted=BEST,
        nominal_works=False,
        decision="adopt",
    ),
    "several sequences, adopt": Case(
        "two", "adopt", f"Adopt the options of trial {OTHER}", OTHER, adopted=OTHER, decision="adopt"
    ),
    "several sequences, keep": Case("two", "keep nominal", "Keep the nominal options", 0, decision="keep nominal"),
    "several sequences, infeasible nominal, keep": Case(
        "two", "keep nominal", NEITHER, None, nominal_works=False, decision="neither"
    ),
}


@pytest.fixture
def database(storage_file: Path, tmp_path: Path) -> Database:
    shutil.copy(storage_file, tmp_path / "gtf-tune.db")
    return open_database(str(tmp_path / "gtf-tune.db"))


def write_case(database: Database, case: Case) -> None:
    study_id = studies.get(database, case.study).id
    if not case.nominal_works:
        failed = {"feasible": False, "value": 1.5, "gtf_ate": None, "message": "a run registered 10% of the frames"}
        nominal = (models.Trial.study_id == study_id) & (models.Trial.number == 0)
        write(database, lambda session: session.execute(update(models.Trial).where(nominal).values(**failed)).close())
    if case.confirmation is not None:
        result = {
            "verdict": case.confirmation,
            "adopted": case.adopted,
            "candidates": [_candidate(number, number == case.adopted) for number in (BEST, OTHER)],
            "nominal": {"ordinal": 0, "options": dict(OPTIONS[0]), "by_sequence": {}},
            "runs": 12,
        }
        confirmations.add(database, study_id, {"run_keys": []}, result, case.confirmation)


def _candidate(number: int, is_adopted: bool) -> dict[str, Any]:
    effect = {"improvement": 0.31, "low": 0.22, "high": 0.39, "p_value": 0.002, "instances": 12}
    verdict = "adopt" if is_adopted else "keep nominal"
    reasons = [] if is_adopted else ["not significantly better than nominal"]
    more = {"adjusted_p_value": 0.004, "verdict": verdict, "reasons": reasons, "by_sequence": {}, "value": 6e-4}
    return {"ordinal": number, "options": dict(OPTIONS[number]), **effect, **more}


def options_of(case: Case) -> dict[str, Any] | None:
    """Return the recommended options as `options.json` nests them."""
    if case.recommended is None:
        return None
    chosen = OPTIONS[case.recommended]
    return {"filter": {"max_error": chosen["filter.max_error"]}, "robust": {"kernel": chosen["robust.kernel"]}}


def words(said: Said) -> str:
    return " ".join(said.out.split())


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_all_say_the_same(case: Case, database: Database, cli: Cli) -> None:  # noqa: F811
    DashboardSync(database, case.study, warn=_fail).write_study()
    write_case(database, case)
    DashboardSync(database, case.study, warn=_fail).write_study()

    best, shown = (json.loads(cli("study", word, case.study, "--json").out) for word in ("best", "show"))
    assert (best["verdict"], best["headline"]) == (case.decision, case.headline)
    assert (best["recommended"] or {}).get("ordinal") == case.recommended
    assert shown["recommendation"]["headline"] == case.headline
    assert shown["recommendation"]["recommended"] == case.recommended
    listed = {one["name"]: one for one in json.loads(cli("study", "list", "--json").out)}[case.study]
    assert (listed["verdict"], listed["recommended"]) == (case.decision, case.recommended)

    assert case.headline in words(cli("study", "best", case.study))
    table = cli("study", "show", case.study)
    assert case.headline in words(table)
    marked = [line.split()[1] for line in table.out.splitlines() if re.match(r" *> \S+ +[0-9]", line)]
    assert marked == (
        [] if case.recommended is None else ["nominal" if not case.recommended else str(case.recommended)]
    )

    exported = cli("study", "export", case.study, "--format", "json")
    assert case.headline in exported.err
    assert (json.loads(exported.out) if exported.code == 0 else None) == options_of(case)

    cli("study", "report", case.study, "-o", "page.html")
    page = html.unescape(Path("page.html").read_text(encoding="utf-8"))
    assert f"<h3>{case.headline}</h3>" in page
    assert ("options.json" in page) == (case.recommended is not None)

    assert _note(database, case.study).startswith(f"# {case.headline}".replace("_", "\\_"))
    assert _attached_options(database, case.study) == options_of(case)
    star = recommended_star(read_search(database, case.study))
    assert (star.number if star else None) == case.recommended


def test_the_improvement_is_one_number(database: Database, cli: Cli) -> None:  # noqa: F811
    change = f"{read_search(database, 'synthetic').improvement(BEST).change}"
    DashboardSync(database, "synthetic", warn=_fail).write_study()
    cli("study", "report", "synthetic", "-o", "page.html")

    said = [cli("study", word, "synthetic").out for word in ("best", "show")]
    said += [Path("page.html").read_text(encoding="utf-8"), _note(database, "synthetic").replace("\\", "")]

    assert re.fullmatch(r"-[0-9]+\.[0-9] %", change)
    assert all(f"GTF ATE {change} (95 % interval " in " ".join(text.split()) for text in said)


def test_figures_and_files_of_an_earlier_recommendation_are_removed(database: Database) -> None:
    def figures() -> set[str]:
        attributes = optuna_storage(database).get_study_system_attrs(studies.get(database, "synthetic").optuna_study_id)
        return {key.split(":")[2] for key in attributes if key.startswith("dashboard:plot_data:gtf-matrix")}

    sync = DashboardSync(database, "synthetic", warn=_fail)
    sync.write_study()
    before = figures()
    write_case(database, CASES["adopt"])
    sync.write_study()

    assert before == {"gtf-matrix-walk-nominal", "gtf-matrix-walk-best"}
    assert figures() == {"gtf-matrix-walk-nominal", "gtf-matrix-walk-recommended"}


def test_a_trial_that_is_asked_for_is_exported_though_none_is_recommended(database: Database, cli: Cli) -> None:  # noqa: F811
    write_case(database, CASES["no verdict"])

    refused = cli("study", "export", "synthetic", "--format", "json")
    named = cli("study", "export", "synthetic", "--format", "json", "--trial", str(BEST))

    assert (refused.code, named.code) == (1, 0)
    assert "--trial N" in refused.err


def test_an_adopted_trial_is_shown_though_it_is_not_among_the_best(database: Database, cli: Cli) -> None:  # noqa: F811
    write_case(database, CASES["adopt another than the luckiest"])
    study_id = studies.get(database, "synthetic").id
    adopted = trials.get(database, study_id, OTHER)
    better = [one for one in trials.ranked(database, study_id, 99) if one.value and one.value < (adopted.value or 0)]

    assert better
    assert f"(trial {OTHER})" in words(cli("study", "best", "synthetic"))


def _note(database: Database, study: str) -> str:
    body: str = optuna_dashboard.get_note(optuna.load_study(study_name=study, storage=optuna_storage(database)))
    return body


def _attached_options(database: Database, study: str) -> dict[str, Any] | None:
    folder = artifact_folder(database)
    assert folder is not None
    attributes = optuna_storage(database).get_study_system_attrs(studies.get(database, study).optuna_study_id)
    records = [json.loads(value) for key, value in attributes.items() if key.startswith("artifacts:")]
    found = [folder / one["artifact_id"] for one in records if one["filename"] == "options.json"]
    return json.loads(found[0].read_text()) if found else None


def _fail(message: str) -> None:
    raise AssertionError(message)
