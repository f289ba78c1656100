"""Find the programs of a definition on this machine, and read their versions."""

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.command.definition import CommandDefinition, words_of
from gtf_tune.pipelines.command.templates import NoValueError, Value, fields_of, filled
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.run import digest

_VERSION_TIMEOUT_S = 60
_LONGEST_VERSION = 100
_SHORT_DIGEST = 12


def program_faults(definition: CommandDefinition, parameters: Mapping[str, Value]) -> Iterator[str]:
    """Yield one sentence for each step whose program is not on this machine."""
    for step in definition.all_steps:
        program = _program(words_of(step.arguments), parameters)
        if not program:
            yield f"step '{step.name}' must start with a program"
        elif shutil.which(program) is None:
            yield f"step '{step.name}': there is no program '{program}' that can be run; install it or give its path"


def program_version(definition: CommandDefinition, parameters: Mapping[str, Value]) -> str:
    """Return what the version command says, or without one a digest of the programs' files.

    A program that a launcher starts counts too: the first word of a step is then the launcher's.

    Raises
    ------
    DefinitionError
        The version command fails, or says something else than expected.
    """
    if definition.version_command:
        return _asked_version(definition, parameters)
    programs = [str(shutil.which(_program(words_of(step.arguments), parameters))) for step in definition.all_steps]
    programs += [program for program in _named_executables(definition, parameters) if program not in programs]
    return "sha256:" + digest([file_digest(Path(program)) for program in programs])[:_SHORT_DIGEST]


def _named_executables(definition: CommandDefinition, parameters: Mapping[str, Value]) -> Iterator[str]:
    """Yield the executables among the parameters that a step names, in the order of the definition."""
    words = [word for step in definition.all_steps for word in words_of(step.arguments)]
    named = {name for word in words for name, _ in fields_of(word)}
    for name, parameter in definition.parameters.items():
        if parameter.kind == "executable" and name in named and name in parameters:
            yield str(parameters[name])


def _program(words: Iterable[str], parameters: Mapping[str, Value]) -> str:
    return next(_known_words(words, parameters), "")


def _known_words(words: Iterable[str], parameters: Mapping[str, Value]) -> Iterator[str]:
    """Yield the words that a command starts with as far as parameters alone decide them."""
    for word in words:
        names = [name for name, _ in fields_of(word)]
        alone = len(names) == 1 and word == f"{{{names[0]}}}"
        value = parameters.get(names[0], ()) if alone else None
        if isinstance(value, tuple):
            yield from value
            continue
        try:
            yield filled(word, parameters)
        except NoValueError:
            return


def _asked_version(definition: CommandDefinition, parameters: Mapping[str, Value]) -> str:
    words = list(_known_words(definition.version_command, parameters))
    if not words:
        raise DefinitionError("'version_command' must start with a program, which parameters alone decide")
    try:
        answer = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=_VERSION_TIMEOUT_S,
            check=False,
        ).stdout.decode(errors="replace")
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        raise DefinitionError(f"the version command {words} failed ({error}); correct 'version_command'") from error
    found = re.search(definition.version_pattern or r"\S.*", answer)
    version = found[found.re.groups > 0] if found else None
    if version is None:
        raise DefinitionError(
            f"the version command {words} did not print what is expected ('{definition.version_pattern}'), but "
            f"{answer.strip()[:_LONGEST_VERSION]!r}; correct 'version_command' or 'version_pattern'"
        )
    return version.strip()[:_LONGEST_VERSION]
