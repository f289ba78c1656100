"""The command line: every command with what it does, and the only error boundary."""

import errno
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

from gtf_tune.cli.parameters import close_storages
from gtf_tune.cli.remedies import with_remedy
from gtf_tune.cli.terminal.console import INTERRUPTED_EXIT_CODE, ready_streams, say, write_line
from gtf_tune.errors import GtfTuneError

_SHORTAGES = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)


@dataclass(frozen=True)
class Entry:
    """Line of a list of commands: its title there, its summary, and what is behind it.

    ``target`` is ``module:function`` below `gtf_tune.cli`; ``commands`` makes a group of it instead. The summary
    repeats the first sentence of the function, so that nothing is imported to print a list; a test compares them.
    """

    title: str
    summary: str
    target: str = ""
    commands: Mapping[str, "Entry"] | None = None


class LazyCommands(Mapping[str, Any]):
    """Commands by name, made from their entries when they are looked up."""

    def __init__(self, entries: Mapping[str, Entry]) -> None:
        self.entries = entries
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            self._made[name] = _make(name, self.entries[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


class CommandGroup(TyperGroup):
    """Group whose commands are imported when they are called; its help lists them under titles, as plain text."""

    table: ClassVar[Mapping[str, Entry]] = {}

    def __init__(self, *, entries: Mapping[str, Entry] | None = None, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = LazyCommands(self.table if entries is None else entries)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, without importing one."""
        del ctx
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each title, in the order of the commands."""
        del ctx
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.commands.entries.items():
            sections.setdefault(entry.title, []).append((name, entry.summary))
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


def _make(name: str, entry: Entry) -> Any:
    if entry.commands is not None:
        return CommandGroup(
            entries=entry.commands, name=name, help=entry.summary, no_args_is_help=True, rich_markup_mode=None
        )
    module, _, function = entry.target.partition(":")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(name)(getattr(import_module(f"gtf_tune.cli.{module}"), function))
    return typer.main.get_command(app)


_STUDY = {
    "create": Entry("Work", "Create a study; flags replace what the definition file says.", "study.create:create"),
    "run": Entry("Work", "Work on a study until its trials are done; goes on where it stopped.", "study.run:run"),
    "resume": Entry("Work", "Go on with a study, after saying what is done and what is left.", "study.run:resume"),
    "confirm": Entry(
        "Work", "Run nominal and the best trials on fresh noise, and say which to adopt.", "study.confirm:confirm"
    ),
    "pause": Entry("Work", "Let every worker finish its trial of a study and take no new one.", "study.state:pause"),
    "stop": Entry(
        "Work", "Let every worker finish its runs in flight, keep them, and leave a study.", "study.state:stop"
    ),
    "retry-failed": Entry(
        "Work",
        "Take back the verdicts of trials whose runs failed, so that these runs are tried again.",
        "study.state:retry_failed",
    ),
    "extend": Entry(
        "Manage",
        "Give a study more trials or wider ranges; changes that make trials incomparable need a new name.",
        "study.edit:extend",
    ),
    "enqueue": Entry(
        "Manage",
        "Add a trial with options that you give, such as a colleague's; the number of trials rises by one.",
        "study.edit:enqueue",
    ),
    "list": Entry("Look", "List the studies of a storage.", "study.listing:list_studies"),
    "compare": Entry(
        "Look",
        "Put studies side by side: what each picked, and what ground truth says of it where there is any.",
        "study.compare:compare",
    ),
    "show": Entry(
        "Look", "Show a study: what is tuned, on what, its trials, and which of them to use.", "study.show:show"
    ),
    "best": Entry("Look", "Print which options to use, how sure that is, and why.", "study.best:best"),
    "rescore": Entry(
        "Look",
        "Show how the trials would rank under another score or error against ground truth, from stored trajectories.",
        "study.rescore:rescore",
    ),
    "export": Entry(
        "Look",
        "Write what reconstructs with the options to use; these as COLMAP's commands or JSON; trials as CSV; "
        "trajectories.",
        "study.export:export",
    ),
    "report": Entry(
        "Look", "Write everything about a study as one HTML page that works offline.", "study.report:report"
    ),
    "watch": Entry(
        "Look",
        "Follow a study until it is done: a line for every trial that ends, and who works on it where.",
        "study.watch:watch",
    ),
    "delete": Entry(
        "Manage", "Delete a study with its trials, and the runs that no other study uses.", "study.delete:delete"
    ),
}
_PIPELINE = {
    "list": Entry("Commands", "List the pipelines that can be tuned here.", "pipeline:list_pipelines"),
    "options": Entry(
        "Commands", "Print every tunable option of a pipeline: name, type, default, meaning.", "pipeline:options"
    ),
    "presets": Entry(
        "Commands",
        "Print the presets of a pipeline: what each searches when nobody says, with the reason for each range.",
        "pipeline:presets",
    ),
    "try": Entry(
        "Commands",
        "Run a pipeline once and show everything that it does, to debug a definition.",
        "pipeline_try:try_pipeline",
    ),
}
_SEQUENCE = {
    "inspect": Entry("Commands", "Print what a data set holds, and warn of what will hurt.", "sequence:inspect"),
    "layouts": Entry(
        "Commands", "Say which data sets are understood, what to download and where to put it.", "sequence:layouts"
    ),
    "extract": Entry(
        "Commands", "Extract frames from a video, by default the sharpest of each period.", "sequence:extract"
    ),
    "render": Entry("Commands", "Render a textured room with exact ground truth.", "sequence:render"),
}
_METRIC = {
    "ate": Entry("Commands", "Print the absolute trajectory error over matched positions.", "metric:ate"),
    "rpe": Entry("Commands", "Print the relative pose error over pairs of poses.", "metric:rpe"),
    "gtf": Entry("Commands", "Print the ground-truth-free score of trajectories that any program made.", "metric:gtf"),
}
_STORAGE = {
    "check": Entry(
        "Commands",
        "Check tables, orphans and the digest of every trajectory; exit with 1 if something is wrong.",
        "storage:check",
    ),
    "upgrade": Entry(
        "Commands",
        "Bring the tables of an older storage, and those of Optuna in it, to this version.",
        "storage:upgrade",
    ),
    "copy": Entry(
        "Commands",
        "Copy a study with all trials, runs, trajectories and notes, and verify the copy by its digest.",
        "storage:copy",
    ),
    "digest": Entry(
        "Commands",
        "Print the digest of what a study found: equal digests mean equal trials, scores and trajectories.",
        "storage:digest",
    ),
}
_CACHE = {
    "info": Entry("Commands", "Show what the stage cache holds.", "cache:info"),
    "prune": Entry("Commands", "Drop the least recently used stages until the rest fits.", "cache:prune"),
    "clear": Entry("Commands", "Drop every stage that no run uses.", "cache:clear"),
}
COMMANDS = {
    "tune": Entry(
        "Start",
        "Find the options that give the most precise trajectory on these images, and reconstruct with them.",
        "tune:tune",
    ),
    "demo": Entry(
        "Start",
        "Render a room, tune GLOMAP on it for three minutes without ground truth, and check the outcome against it.",
        "demo:demo",
    ),
    "study": Entry("Studies", "Create, run and read studies.", commands=_STUDY),
    "dashboard": Entry(
        "Studies",
        "Open optuna-dashboard on a storage; it asks for no password, so it listens on this machine only.",
        "dashboard:dashboard",
    ),
    "worker": Entry(
        "Studies", "Work on every open study of a storage, as one of many workers on many machines.", "worker:worker"
    ),
    "evaluate": Entry(
        "Studies",
        "Print the GTF ATE of one configuration on one sequence; nothing is stored unless a storage is given.",
        "measure.evaluate:evaluate",
    ),
    "compare": Entry(
        "Studies",
        "Compare systems on one sequence under the same noise: score, interval, registered frames, time.",
        "measure.compare:compare",
    ),
    "check": Entry(
        "Studies",
        "Say whether options that were tuned elsewhere hold on these images, with as few runs as that takes.",
        "measure.check:check",
    ),
    "noise": Entry(
        "Studies",
        "Measure how the score grows with the noise, and recommend a noise in the linear range; nothing is stored.",
        "measure.noise:noise",
    ),
    "pipeline": Entry("Inputs", "List pipelines and their tunable options.", commands=_PIPELINE),
    "sequence": Entry("Inputs", "Check data sets, take frames from videos, render a scene.", commands=_SEQUENCE),
    "metric": Entry("Tools", "Compute errors and scores of trajectory files.", commands=_METRIC),
    "storage": Entry("Tools", "Check, upgrade and copy storages.", commands=_STORAGE),
    "cache": Entry("Tools", "Look at the stage cache, and make room.", commands=_CACHE),
    "doctor": Entry(
        "Start", "Check packages, memory, the cache folder and the options of the installed COLMAP.", "doctor:doctor"
    ),
}


class MainGroup(CommandGroup):
    """Every command."""

    table = COMMANDS


app = typer.Typer(
    name="gtf-tune",
    cls=MainGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from gtf_tune.version import __version__

        write_line(f"gtf-tune {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Tune Structure-from-Motion and visual SLAM without ground truth."""
    del version


def _is_of_threads(error: BaseException) -> bool:
    """Whether an error comes from the module `threading` itself: no thread could be started, or one never was."""
    last = traceback.extract_tb(error.__traceback__, limit=-1)
    return bool(last) and last[0].filename == threading.__file__


def main() -> None:
    """Run the command line; a `GtfTuneError` becomes one sentence on stderr and exit code 1, Ctrl-C exit code 130."""
    ready_streams()
    try:
        app()
    except GtfTuneError as error:
        say(f"error: {with_remedy(error)}")
        sys.exit(1)
    except OSError as error:
        if error.errno not in _SHORTAGES:
            raise
        say(f"error: this machine gives no more ({error.strerror}); end other programs or raise its limits (ulimit -a)")
        sys.exit(1)
    except RuntimeError as error:
        if not _is_of_threads(error):
            raise
        say("error: this machine starts no more threads; end other programs or raise its limits (ulimit -u)")
        sys.exit(1)
    except KeyboardInterrupt:  # before the command has begun, or after it; in between typer hears of it
        sys.exit(INTERRUPTED_EXIT_CODE)
    finally:
        close_storages()
