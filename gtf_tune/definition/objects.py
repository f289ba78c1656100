"""Import what a definition names as ``module:attribute``."""

import sys
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import Any

from gtf_tune.errors import DefinitionError


def load_object(target: str, kind: str, folder: str = "") -> Any:
    """Return what ``module:attribute`` names; ``kind`` is what it is meant to be, for messages.

    Modules are also looked for in ``folder``, the working folder unless given.

    Raises
    ------
    DefinitionError
        The module cannot be imported here, or has no such attribute.
    """
    name, _, attribute = target.partition(":")
    folder = folder or str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        return reduce(getattr, attribute.split("."), import_module(name))
    except Exception as error:  # a module runs code of any kind
        raise DefinitionError(
            f"{kind} '{target}' cannot be imported ({type(error).__name__}: {error}); install its package, or work in "
            "the folder of its module"
        ) from error
