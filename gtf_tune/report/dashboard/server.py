"""Serve optuna-dashboard on our storage."""

import socket
import webbrowser
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any, Self
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

import optuna_dashboard

from gtf_tune.errors import DefinitionError, OptunaStudyError
from gtf_tune.report.dashboard.shown_values import show_values
from gtf_tune.report.dashboard.upkeep import Upkeep
from gtf_tune.report.dashboard.writer import artifact_folder, artifact_store
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.link import optuna_study_id
from gtf_tune.store.optuna.tables import optuna_storage

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8080

_POLL_S = 0.1

_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
_Application = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]


def serve_dashboard(
    database: Database,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    *,
    artifacts: Path | None = None,
    announce: Callable[[str], None] = lambda _: None,
    open_browser: bool = True,
) -> None:
    """Serve the studies of a database in optuna-dashboard until Ctrl-C, and keep notes, figures and files up to date.

    ``announce`` receives sentences for the user, the link among them. Port 0 takes any free port. optuna-dashboard has
    no passwords: only a loopback address keeps others from deleting studies.

    Raises
    ------
    DefinitionError
        The address cannot be served.
    """
    with (
        DashboardServer(database, host, port, artifacts) as server,
        Upkeep(database, artifacts=artifacts, warn=announce),
    ):
        if host not in _LOOPBACK:
            announce(f"warning: anybody who can reach {host} can change and delete studies; prefer an ssh tunnel")
        announce(f"dashboard of {database.shown_url}: {server.link} (begin with a study's page Note; Ctrl-C ends it)")
        if open_browser:
            webbrowser.open(server.link)
        try:
            server.serve()
        except KeyboardInterrupt:
            announce("dashboard ended")


class DashboardServer:
    """Server of optuna-dashboard; it answers while `serve` runs, in any thread.

    Raises
    ------
    DefinitionError
        The address cannot be served.
    """

    def __init__(
        self, database: Database, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT, artifacts: Path | None = None
    ) -> None:
        application = optuna_dashboard.wsgi(
            show_values(optuna_storage(database), database), artifact_store=_store(artifact_folder(database, artifacts))
        )
        if host in _LOOPBACK:
            application = _refuse_other_names(application)
        try:
            self._http = make_server(host, port, application, server_class=_Server, handler_class=_QuietHandler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DefinitionError(
                f"the dashboard cannot listen on {host}:{port} ({reason}); choose another port or host",
                remedy=("port",),
            ) from error
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self._http.server_port}"
        self.link = f"{self.url}/dashboard{_only_study(database)}"

    def serve(self) -> None:
        """Handle requests until `stop` is called from another thread."""
        self._http.serve_forever(poll_interval=_POLL_S)

    def stop(self) -> None:
        """End `serve`."""
        self._http.shutdown()

    def __enter__(self) -> Self:
        """Return the server itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Give the port back."""
        self._http.server_close()


class _Server(ThreadingMixIn, WSGIServer):
    daemon_threads = True

    def server_bind(self) -> None:
        # The standard library looks up its own host name here, which can take seconds without a network.
        if ":" in str(self.server_address[0]):
            self.address_family = socket.AF_INET6
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])
        self.setup_environ()


class _QuietHandler(WSGIRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""


def _store(folder: Path | None) -> Any:
    try:
        return artifact_store(folder)
    except OSError:
        return None


def _only_study(database: Database) -> str:
    names = studies.names(database)
    with suppress(OptunaStudyError):
        return f"/studies/{optuna_study_id(database, studies.get(database, names[0]))}" if len(names) == 1 else ""
    return ""


def _refuse_other_names(application: _Application) -> _Application:
    """Refuse requests under other names than this machine's own, since any web page may point its name at 127.0.0.1."""

    def checked(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
        host = str(environ.get("HTTP_HOST", ""))
        name = host.rpartition("]")[0].removeprefix("[") if host.startswith("[") else host.partition(":")[0]
        if name.lower() in _LOOPBACK:
            return application(environ, start_response)
        start_response("403 Forbidden", [("Content-Type", "text/plain")])
        return [b"This dashboard is available as 127.0.0.1 and localhost only.\n"]

    return checked
