"""Import what a definition names as ``module:attribute``."""

from importlib import import_module
from typing import Any

from gtf_tune.errors import DefinitionError, did_you_mean


def load_object(name: str, kind: str) -> Any:
    """Return what ``module:attribute`` names; ``kind`` is what it is meant to be, for messages.

    Raises
    ------
    DefinitionError
        The module cannot be imported here, or has no such attribute.
    """
    module_name, _, attribute = name.partition(":")
    try:
        module = import_module(module_name)
    except Exception as error:  # whatever the module itself does when it is imported
        raise DefinitionError(
            f"{kind} '{name}' cannot be imported ({type(error).__name__}: {error}); install its package here, or put "
            "the folder of its module on PYTHONPATH"
        ) from error
    try:
        return getattr(module, attribute)
    except AttributeError as error:
        hint = did_you_mean(attribute, vars(module), otherwise="check its name")
        raise DefinitionError(f"{kind} '{name}': module '{module_name}' has no '{attribute}'; {hint}") from error
