"""Define every error that gtf-tune raises on purpose, and word what their messages have in common.

::

    GtfTuneError
    |-- DefinitionError      a study definition, a flag or a search space is wrong
    |   `-- OptionError      a pipeline option is unknown, of the wrong type or refused
    |-- SequenceError        images, timestamps, intrinsics or a data-set layout are wrong
    |-- TrajectoryError      a trajectory is unreadable, or a pair of them cannot be aligned
    |-- RunError             one run of a pipeline failed, with the reason
    |-- MachineError         this machine is at fault: disk, permissions, programs that work elsewhere
    `-- StorageError         the database is missing, damaged, locked, too old or says otherwise
        |-- UnreachableError  its server does not answer, which may pass
        |-- DeletedError      the study was deleted while it was worked on
        `-- OptunaStudyError  another program renamed, deleted or changed the Optuna study of a study

Every message is one sentence (what was expected, what came, where), then what to do. The command line prints it and
exits with 1; any other exception is a defect and keeps its traceback.
"""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches


class GtfTuneError(Exception):
    """A fault that the user can understand and put right.

    ``remedy`` names what helps where the interface decides how that is done: an action and its arguments, such as
    ``("sequence", "room")`` for saying where a sequence lies. The command line adds the flag or the command.
    """

    def __init__(self, message: str = "", *, remedy: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.remedy = remedy


class DefinitionError(GtfTuneError):
    """Signal a study definition, flag or search space that cannot be used."""


class OptionError(DefinitionError):
    """Signal a pipeline option that is unknown, of the wrong type or refused by the pipeline."""


class SequenceError(GtfTuneError):
    """Signal images, timestamps, intrinsics or a layout that cannot be read."""


class TrajectoryError(GtfTuneError):
    """Signal a trajectory that cannot be read, or a pair that cannot be associated or aligned."""


class RunError(GtfTuneError):
    """Signal that one run of a pipeline failed; the message is the reason stored with the run.

    ``died_of`` is the number of the signal that ended the program, 0 where it ended itself.
    """

    def __init__(self, message: str = "", *, died_of: int = 0) -> None:
        super().__init__(message)
        self.died_of = died_of


class MachineError(GtfTuneError):
    """Signal that runs fail because of this machine, which says nothing about the configurations that they try."""


class StorageError(GtfTuneError):
    """Signal a database that cannot be opened, read or written as asked."""


class UnreachableError(StorageError):
    """Signal that the server of a database does not answer now."""


class DeletedError(StorageError):
    """Signal that someone deleted a study while it was worked on."""


class OptunaStudyError(StorageError):
    """Signal that another program renamed, deleted or changed the Optuna study of a study."""


def first_remedy(faults: Iterable[GtfTuneError]) -> tuple[str, ...]:
    """Return the first remedy of several errors that one message reports, empty if none has one."""
    return next((fault.remedy for fault in faults if fault.remedy), ())


def did_you_mean(name: str, known: Iterable[str], *, most: int = 2, cutoff: float = 0.6, otherwise: str = "") -> str:
    """Return the question whether a near name was meant, or ``otherwise`` where none is near.

    ``cutoff`` in [0, 1] is how alike names must be (`difflib.get_close_matches`), ``most`` how many are asked about.
    """
    near = get_close_matches(name, list(known), most, cutoff)
    return f"did you mean {' or '.join(map(repr, near))}?" if near else otherwise


def numbered(faults: Sequence[str]) -> str:
    """Return all faults in one line, numbered where there are several."""
    if len(faults) == 1:
        return faults[0]
    return f"{len(faults)} faults: " + "; ".join(f"({number}) {fault}" for number, fault in enumerate(faults, start=1))
