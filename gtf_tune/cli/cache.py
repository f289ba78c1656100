"""Look at the stage cache, and make room."""

from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import CacheDir, Json
from gtf_tune.cli.terminal.console import say, write_json, write_table

if TYPE_CHECKING:
    from gtf_tune.execution import StageCache

_MIB = 2**20
_GIB = 2**30


def info(cache_dir: CacheDir = None, json: Json = False) -> None:
    """Show what the stage cache holds.

    Example: gtf-tune cache info
    """
    cache = _cache(cache_dir)
    found = cache.info()
    if json:
        write_json({**vars(found), "folder": str(found.folder)})
        return
    rows = [(stage, str(count), f"{found.bytes[stage] / _MIB:.1f}") for stage, count in sorted(found.entries.items())]
    rows.append(("all", str(sum(found.entries.values())), f"{sum(found.bytes.values()) / _MIB:.1f}"))
    write_table(["stage", ">entries", ">MiB"], rows)
    say(f"cache: {found.folder} (limit {found.limit_bytes / _GIB:g} GiB)")


def prune(
    limit_gb: Annotated[float, typer.Option("--limit-gb", min=0, max=1e9, help="Keep at most this much.")] = 20.0,
    cache_dir: CacheDir = None,
) -> None:
    """Drop the least recently used stages until the rest fits.

    Example: gtf-tune cache prune --limit-gb 5
    """
    freed = _cache(cache_dir).prune(int(limit_gb * _GIB))
    say(f"freed {freed / _MIB:.1f} MiB")


def clear(cache_dir: CacheDir = None) -> None:
    """Drop every stage that no run uses.

    Example: gtf-tune cache clear
    """
    say(f"freed {_cache(cache_dir).clear() / _MIB:.1f} MiB")


def _cache(cache_dir: CacheDir) -> "StageCache":
    from gtf_tune.execution import StageCache, default_cache_folder

    return StageCache(cache_dir or default_cache_folder())
