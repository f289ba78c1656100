"""Find what a definition names by relative paths: files, folders and programs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from gtf_tune.pipelines.command.definition import Arguments, CommandDefinition

RELATIVE_TO = "relative_to"
"""Setting with the folder that relative paths start from: a study has that of its definition file."""


@dataclass(frozen=True)
class Places:
    """Folders in which relative paths are looked for, the first that has them first."""

    folders: tuple[Path, ...]

    def find(self, text: str) -> Path:
        """Return the absolute path that a text stands for; in the first folder where no folder has it."""
        path = Path(text).expanduser()
        found = (folder / path for folder in self.folders if (folder / path).exists())
        return next(found, self.folders[0] / path)

    def located(self, definition: CommandDefinition) -> CommandDefinition:
        """Return a definition with absolute paths for the files that it names without placeholders."""
        changes = {
            "arguments": self._words(definition.arguments),
            "steps": tuple(
                step.model_copy(update={"arguments": self._words(step.arguments)}) for step in definition.steps
            ),
            "files": tuple(
                file.model_copy(update={"link": self._path(file.link)}) if file.link else file
                for file in definition.files
            ),
            "settings_files": tuple(
                file.model_copy(update={"template": self._path(file.template)}) for file in definition.settings_files
            ),
            "version_command": self._words(definition.version_command),
        }
        return definition.model_copy(update=changes)

    def _path(self, text: str) -> str:
        if "{" in text or Path(text).is_absolute():
            return text
        found = self.find(text)
        return str(found) if found.exists() else text

    def _words(self, arguments: Arguments) -> Arguments:
        """Return words with absolute paths for those that have a slash and name a file, as shells take programs."""
        return tuple(
            self._word(argument) if isinstance(argument, str) else tuple(self._word(word) for word in argument)
            for argument in arguments
        )

    def _word(self, word: str) -> str:
        return self._path(word) if "/" in word and self.find(word).is_file() else word


def places_of(settings: Mapping[str, object], definition_file: Path | None = None) -> Places:
    """Return where relative paths of these settings, and of the definition file that they name, are looked for.

    Studies that were stored without a folder go by the current one first, as they did when they were made.
    """
    given = settings.get(RELATIVE_TO)
    own = [] if definition_file is None else [definition_file.absolute().parent]
    here = Path.cwd()
    return Places((here, *own) if given is None else (Path(str(given)).absolute(), *own, here))


def rooted(settings: Mapping[str, object], folder: Path) -> Mapping[str, object]:
    """Return settings whose relative paths start from a folder, unless they say themselves from where."""
    return MappingProxyType({RELATIVE_TO: str(folder.absolute()), **settings})
