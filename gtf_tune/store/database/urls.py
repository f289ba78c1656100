"""Read the URL of a storage, and show it without its password."""

from pathlib import Path

from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError

from gtf_tune.errors import StorageError

_POSTGRESQL_PORT = 5432
_SECRET_QUERY_KEYS = frozenset({"password", "sslpassword"})


def parse_url(storage: str) -> URL:
    """Return the URL of a storage given as a file path, ``sqlite:///FILE`` or ``postgresql://USER@HOST/NAME``.

    ``@FILE`` stands for the text in a file: a password then is neither on a command line nor in the environment.

    Raises
    ------
    StorageError
        The text is no URL, names another kind of database, or is a SQLite URL without a file.
    """
    if storage.startswith("@"):
        storage = _content_of(Path(storage[1:]).expanduser())
    if not storage.strip():
        raise StorageError("the storage is empty; give a file such as gtf-tune.db or a postgresql+psycopg:// URL")
    if "://" not in storage:
        return URL.create("sqlite", database=str(Path(storage).expanduser()))
    try:
        url = make_url(storage)
    except (ArgumentError, ValueError) as error:
        raise StorageError(
            "the storage URL cannot be read; write sqlite:///FILE or postgresql+psycopg://USER@HOST:PORT/NAME, "
            "with special characters of the password percent-encoded"
        ) from error
    return _checked(url)


def _content_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise StorageError(f"{path}, which should hold the URL of the storage, cannot be read ({reason})") from error


def _checked(url: URL) -> URL:
    backend = url.get_backend_name()
    if backend == "postgresql":
        return url.set(drivername="postgresql+psycopg")
    if backend != "sqlite":
        raise StorageError(f"the storage must be SQLite or PostgreSQL, not '{backend}'; see storage/README.md")
    if not url.database or url.database == ":memory:" or url.database.startswith("file:"):
        raise StorageError("a SQLite storage must be a file on disk; write sqlite:///FILE")
    return url.set(drivername="sqlite")


def display_url(url: URL | str) -> str:
    """Return a storage URL for messages and logs, every password in it replaced by stars."""
    parsed = parse_url(url) if isinstance(url, str) else url
    secrets = {key: "***" for key in parsed.query if key in _SECRET_QUERY_KEYS}
    return parsed.update_query_dict(secrets).render_as_string(hide_password=True)


def place_of(url: URL) -> tuple[str, ...]:
    """Return what is equal for two URLs that are certain to name the same database, whoever asks for it."""
    if url.get_backend_name() == "sqlite":
        return (str(Path(str(url.database)).resolve()),)
    return (url.host or "", str(url.port or _POSTGRESQL_PORT), url.database or "", str(url.query.get("host", "")))


def without_passwords(text: str, url: URL) -> str:
    """Return a driver's message with every password of the URL replaced by stars."""
    queried = (value for key, value in url.query.items() if key in _SECRET_QUERY_KEYS)
    for secret in (url.password, *queried):
        if isinstance(secret, str) and secret:
            text = text.replace(secret, "***")
    return text
