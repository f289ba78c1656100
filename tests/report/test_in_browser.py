"""Look at the report and at optuna-dashboard as a person does, in a real browser."""

import json
import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from html import unescape
from pathlib import Path

import pytest

from gtf_tune.report.build import Extras, write_report
from gtf_tune.report.dashboard.server import DashboardServer
from gtf_tune.report.dashboard.sync import DashboardSync
from gtf_tune.report.definition import ReportDefinition
from gtf_tune.store.database import Database
from tests.report.test_models import cloud

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

DARK = "--force-dark-mode"
AXE = Path(__file__).parents[2] / "node_modules" / "axe-core" / "axe.min.js"
RUN_AXE = """
addEventListener("load", () => setTimeout(async () => {
  const found = await axe.run();
  const result = document.createElement("pre");
  result.id = "axe-result";
  result.textContent = JSON.stringify(found.violations.map(
    (fault) => [fault.impact, fault.id, fault.nodes.map((node) => node.target.join(" "))]
  ));
  document.body.append(result);
}, 8000));
"""

Load = Callable[[str], str]


@pytest.fixture(scope="module")
def chromium() -> str:
    """Return the path of a browser."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium here: install Debian's chromium")
    return found


def content(chromium: str, folder: Path, url: str, *flags: str, width: int = 1400) -> str:
    """Load a page, let its scripts run and return its content then."""
    command = [chromium, *QUIET, *flags, f"--user-data-dir={folder / 'profile'}", f"--window-size={width},16000"]
    command += ["--virtual-time-budget=20000", "--dump-dom", url]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


@pytest.fixture
def load(chromium: str, tmp_path: Path) -> Load:
    """Return a function that loads a page and returns its content."""
    return lambda url: content(chromium, tmp_path, url)


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


@pytest.fixture(scope="module", params=[(1400, ()), (500, (DARK,))], ids=["wide", "narrow and dark"])
def shown(
    request: pytest.FixtureRequest, database: Database, chromium: str, tmp_path_factory: pytest.TempPathFactory
) -> str:
    """Return the content of a report as a browser shows it, with the findings of axe-core if that is installed."""
    width, flags = request.param
    folder = tmp_path_factory.mktemp("report")
    path = folder / "report.html"
    extras = Extras({"options.json": "{}"}, {"nominal options": cloud(), "adopted options": cloud()})
    write_report(path, database, "synthetic", ReportDefinition(), extras)
    if AXE.exists():
        script = f"<script>{AXE.read_text(encoding='utf-8')}\n{RUN_AXE}</script></body>"
        path.write_text(path.read_text(encoding="utf-8").replace("</body>", script), encoding="utf-8")
    return content(chromium, folder, path.as_uri(), *flags, width=width)


def test_every_figure_of_the_report_is_drawn(shown: str) -> None:
    plots = shown.count("data-spec=")
    assert plots >= 16
    assert shown.count('data-drawn="yes"') == plots
    assert len(re.findall(r'<svg class="main-svg"', shown)) >= plots
    assert "best so far: 0.002" in shown


def test_figures_are_dark_on_dark_pages_only(shown: str, request: pytest.FixtureRequest) -> None:
    is_dark = "dark]" in request.node.name

    assert ("fill: rgb(27, 34, 42)" in shown) == is_dark


def test_the_report_has_no_serious_fault_of_accessibility(shown: str) -> None:
    if not AXE.exists():
        pytest.skip("no axe-core here: npm install --no-save --prefix . axe-core@4")
    found = re.search(r'<pre id="axe-result">(.*?)</pre>', shown, flags=re.DOTALL)

    assert found is not None
    violations = json.loads(unescape(found.group(1)))
    assert [violation for violation in violations if violation[0] in ("serious", "critical")] == []


def test_the_dashboard_shows_our_figures_and_values(dashboard: str, load: Load) -> None:
    page = load(dashboard)

    for words in (
        "GTF vs ground truth",
        "filter.max_error",
        "least true ATE: 0.002",
        "GTF ATE [‰ of extent]",
        "nominal",
    ):
        assert words in page


def test_the_dashboard_shows_notes_failures_and_files_of_a_trial(dashboard: str, load: Load) -> None:
    page = load(f"{dashboard}/trials?numbers=6")

    for words in ("this trial", "the pipeline crashed its process (SIGABRT)", "failed-runs.log", "matrix.csv"):
        assert words in page


def test_the_dashboard_shows_the_note_of_the_study(dashboard: str, load: Load) -> None:
    page = load(f"{dashboard}/note")

    for words in ("Trial 3 is the best so far", "What is tuned", "How to read it"):
        assert words in page
