"""Look at the report and at optuna-dashboard as a person does, in a real browser."""

import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gtf_tune.report.build import write_report
from gtf_tune.report.dashboard.server import DashboardServer
from gtf_tune.report.dashboard.sync import DashboardSync
from gtf_tune.report.definition import ReportDefinition
from gtf_tune.store.database import Database

QUIET = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
]

Load = Callable[[str], str]


@pytest.fixture(scope="module")
def chromium() -> str:
    """Return the path of a browser."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium here: install Debian's chromium")
    return found


@pytest.fixture
def load(chromium: str, tmp_path: Path) -> Load:
    """Return a function that loads a page, lets its scripts run and returns what stands in it then."""

    def load(url: str) -> str:
        command = [chromium, *QUIET, f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1400,9000"]
        command += ["--virtual-time-budget=20000", "--dump-dom", url]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout

    return load


@pytest.fixture
def dashboard(own_database: Database) -> Iterator[str]:
    """Yield the address of a dashboard with the content of ``synthetic``."""
    synced = DashboardSync(own_database, "synthetic")
    synced.write_study()
    synced.write_trial(6)
    with DashboardServer(own_database, port=0) as server:
        thread = threading.Thread(target=server.serve)
        thread.start()
        yield f"{server.url}/dashboard/studies/1"
        server.stop()
        thread.join()


def test_every_figure_of_the_report_is_drawn(database: Database, load: Load, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, database, "synthetic", ReportDefinition())

    page = load(path.as_uri())

    plots = page.count("data-spec=")
    assert plots >= 14
    assert page.count('data-drawn="yes"') == plots
    assert len(re.findall(r'<svg class="main-svg"', page)) >= plots
    assert "best so far: 0.002" in page


def test_the_dashboard_shows_our_figures_and_values(dashboard: str, load: Load) -> None:
    page = load(dashboard)

    for words in ("GTF vs ground truth", "filter.max_error", "least true ATE: 0.002", "GTF ATE / extent", "nominal"):
        assert words in page


def test_the_dashboard_shows_notes_failures_and_files_of_a_trial(dashboard: str, load: Load) -> None:
    page = load(f"{dashboard}/trials?numbers=6")

    for words in ("this trial", "the pipeline crashed its process (SIGABRT)", "failed-runs.log", "matrix.csv"):
        assert words in page


def test_the_dashboard_shows_the_note_of_the_study(dashboard: str, load: Load) -> None:
    page = load(f"{dashboard}/note")

    for words in ("Trial 3 is the best so far", "What is tuned", "How to read it"):
        assert words in page
