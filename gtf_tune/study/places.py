"""Find the sequences of studies on this machine, by their names."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gtf_tune.definition import SequenceDefinition, StudyDefinition
from gtf_tune.errors import SequenceError
from gtf_tune.store.studies import StudySequence


@dataclass(frozen=True)
class SequencePlaces:
    """Say where sequences lie here: named ones in ``named``, others below ``data_root`` or where the study began.

    Whatever is found is compared with the study's fingerprint before anything runs on it.
    """

    named: Mapping[str, Path] = field(default_factory=dict)
    data_root: Path | None = None

    def of(self, sequences: list[StudySequence]) -> dict[str, Path]:
        """Return the places of those sequences that do not lie where their study says.

        Raises
        ------
        SequenceError
            A data root is given and a sequence is neither below it nor named.
        """
        found = {one.name: self.named[one.name] for one in sequences if one.name in self.named}
        if self.data_root is None:
            return found
        return found | {one.name: _below(self.data_root, one) for one in sequences if one.name not in found}


def folders_of(definition: StudyDefinition, root: Path, named: Mapping[str, Path]) -> dict[str, Path]:
    """Return where the searched sequences lie: where ``named`` says, otherwise where the study says.

    Raises
    ------
    SequenceError
        ``named`` has a name that no sequence has, or a sequence does not lie where the study says.
    """
    names = [one.name for one in definition.sequences]
    for name in named:
        if name not in names:
            raise SequenceError(f"--sequence {name}=PATH: study '{definition.name}' has only {', '.join(names)}")
    return {one.name: folder_of(one, root, named) for one in definition.searched_sequences}


def folder_of(sequence: SequenceDefinition, root: Path, named: Mapping[str, Path]) -> Path:
    """Return where one sequence of a study lies: where ``named`` says, otherwise where the study says.

    Raises
    ------
    SequenceError
        It does not lie where the study says.
    """
    if sequence.name in named:
        return named[sequence.name]
    folder = root / sequence.path
    if not folder.exists():
        raise SequenceError(
            f"sequence '{sequence.name}' is not at {folder} on this machine; give its place with --sequence "
            f"{sequence.name}=PATH"
        )
    return folder


def _below(root: Path, sequence: StudySequence) -> Path:
    for place in (root / sequence.name, root / Path(sequence.path).name):
        if place.exists():
            return place
    raise SequenceError(
        f"sequence '{sequence.name}' is not in {root}; put it there under its name, or give its place with "
        f"--sequence {sequence.name}=PATH"
    )
