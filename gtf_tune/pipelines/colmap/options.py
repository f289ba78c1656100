"""Read, check and set the whole option tree of pycolmap by dotted path.

Nothing here lists options. The option objects of the installed pycolmap say what a user may tune, by three rules:

- truth values, whole numbers, numbers and enumerations are options; paths, texts, lists and sets are not, because they
  name files, devices or images;
- a name with one of `_RUN_WORDS` among its words is set by the run (threads, seeds, GPU, clocks, what is printed or
  written), so it is not an option;
- a field that its owner overwrites with one of its own (see ``get_mapper()`` of the incremental pipeline) would be
  ignored, so it is not an option.
"""

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import pycolmap

from gtf_tune.errors import OptionError
from gtf_tune.pipelines.colmap.option_notes import option_note
from gtf_tune.pipelines.options import OptionSpec, OptionTable, OptionValue

_RUN_WORDS = frozenset(
    {"threads", "threading", "workers", "gpu", "seed", "seconds", "id1", "id2"}
    | {"colors", "dump", "gradients", "logging", "snapshot", "stdout", "summary"}
)
# pybind's dataclass wrapper appends the default of a bare object, which is not always the one in force here.
_DEFAULT_NOTE = re.compile(r"\s*\(\w+, default: .*\)$", re.DOTALL)

AttributePath = tuple[str, ...]


@dataclass(frozen=True)
class OptionRoot:
    """Say where the fields of one pycolmap class appear among the options.

    ``prefixes`` maps attribute paths inside the class to the first part of option names; the longest path wins.
    ``pinned`` are fields that the run sets itself.
    """

    class_name: str
    stage: str
    prefixes: Mapping[AttributePath, str]
    pinned: frozenset[str] = frozenset()

    def create(self) -> Any:
        """Return a new object with pycolmap's defaults."""
        return getattr(pycolmap, self.class_name)()

    def option_name(self, path: AttributePath) -> str:
        """Return the dotted option name of an attribute."""
        mount = max((head for head in self.prefixes if path[: len(head)] == head), key=len)
        return ".".join((self.prefixes[mount], *path[len(mount) :]))


@dataclass(frozen=True)
class _Leaf:
    root: str
    path: AttributePath
    spec: OptionSpec


@dataclass(frozen=True)
class OptionObjects:
    """The option objects of one run, ready for use, and the values that they carry.

    Objects belong to one run and are never shared. ``values[root]`` are the tunable values in force, defaults included,
    so that an explicit default and an absent option are the same thing.
    """

    objects: Mapping[str, Any]
    values: Mapping[str, Mapping[str, OptionValue]]

    def __getitem__(self, root: str) -> Any:
        return self.objects[root]


@dataclass(frozen=True)
class OptionTree:
    """Every option of the pycolmap classes that a pipeline uses."""

    roots: Mapping[str, OptionRoot]
    leaves: Mapping[str, _Leaf] = field(repr=False)

    def table(self, pipeline: str, check_more: Callable[[Mapping[str, OptionValue]], None]) -> OptionTable:
        """Return the options as a table; ``check_more`` runs after pycolmap has accepted the values."""

        def check(values: Mapping[str, OptionValue]) -> None:
            self.check(values)
            check_more(values)

        return OptionTable(pipeline, {name: leaf.spec for name, leaf in self.leaves.items()}, check)

    def check(self, values: Mapping[str, OptionValue]) -> None:
        """Raise `OptionError` if pycolmap refuses the values."""
        objects = self.build(values, threads=1, seed=0)
        with _quiet_log():
            for name, root in self.roots.items():
                for path, owner in _owners(objects[name]):
                    if not _accepts(owner):
                        raise OptionError(_refusal(values, prefix=root.option_name((*path, ""))))

    def build(self, values: Mapping[str, OptionValue], *, threads: int, seed: int) -> OptionObjects:
        """Return new option objects with the values set, on the CPU, with these threads and this seed everywhere."""
        objects = {name: root.create() for name, root in self.roots.items()}
        for root in objects.values():
            _set_run_fields(root, threads=threads, seed=seed)
        self._assign(objects, values)
        in_force: dict[str, dict[str, OptionValue]] = {name: {} for name in self.roots}
        for name, leaf in self.leaves.items():
            in_force[leaf.root][name] = _read(objects[leaf.root], leaf.path)
        return OptionObjects(objects, in_force)

    def _assign(self, objects: Mapping[str, Any], values: Mapping[str, OptionValue]) -> None:
        for name, value in values.items():
            leaf = self.leaves[name]
            owner, attribute = _owner_of(objects[leaf.root], leaf.path)
            members = getattr(type(getattr(owner, attribute)), "__members__", None)
            try:
                setattr(owner, attribute, members[str(value)] if members else value)
            except (TypeError, ValueError, OverflowError) as error:
                raise OptionError(f"option '{name}' cannot hold {value!r} in pycolmap; choose another value") from error


def read_tree(roots: Mapping[str, OptionRoot]) -> OptionTree:
    """Return the option tree of pycolmap classes by reading their default objects."""
    leaves = {}
    for name, root in roots.items():
        for path, owner in _owners(root.create()):
            for attribute, value in _scalars(owner):
                if attribute in root.pinned or _is_run_field(attribute) or _is_overwritten(root, (*path, attribute)):
                    continue
                spec = _spec(root, (*path, attribute), owner, value)
                leaves[spec.name] = _Leaf(name, (*path, attribute), spec)
    return OptionTree(roots, dict(sorted(leaves.items())))


def _accepts(owner: Any) -> bool:
    """Ask the object itself: COLMAP's check() answers or raises, Ceres' IsValid() answers with a reason."""
    try:
        if hasattr(owner, "IsValid"):
            return bool(owner.IsValid()[0])
        return not hasattr(owner, "check") or owner.check() is not False
    except (RuntimeError, ValueError):
        return False


def _refusal(values: Mapping[str, OptionValue], prefix: str) -> str:
    given = {name: value for name, value in values.items() if name.startswith(prefix)} or values
    shown = ", ".join(f"'{name}' = {value!r}" for name, value in sorted(given.items()))
    return f"pycolmap {pycolmap.__version__} refuses {shown}; choose a value inside the range that it accepts"


def _spec(root: OptionRoot, path: AttributePath, owner: Any, value: Any) -> OptionSpec:
    name = root.option_name(path)
    return OptionSpec(
        name=name,
        default=_plain(value),
        documentation=_DEFAULT_NOTE.sub("", getattr(type(owner), path[-1]).__doc__ or "").strip() or option_note(name),
        choices=tuple(getattr(type(value), "__members__", ())),
        stage=root.stage,
    )


def _owners(root: Any, path: AttributePath = ()) -> Iterator[tuple[AttributePath, Any]]:
    """Yield the object and every option object inside it, children first, with their attribute paths."""
    for name, value in _fields(root):
        if hasattr(value, "todict"):
            yield from _owners(value, (*path, name))
    yield path, root


def _scalars(owner: Any) -> Iterator[tuple[str, Any]]:
    for name, value in _fields(owner):
        if isinstance(value, bool | int | float) or hasattr(type(value), "__members__"):
            yield name, value


def _fields(owner: Any) -> Iterator[tuple[str, Any]]:
    for name in dir(type(owner)):
        attribute = getattr(type(owner), name)
        if isinstance(attribute, property) and attribute.fset is not None:
            yield name, getattr(owner, name)


def _is_run_field(name: str) -> bool:
    return not _RUN_WORDS.isdisjoint(name.split("_"))


def _is_overwritten(root: OptionRoot, path: AttributePath) -> bool:
    """Return whether the owner's ``get_<child>()`` ignores a value that was set on the child."""
    for depth in range(len(path) - 1):
        whole = root.create()
        owner, child = _owner_of(whole, path[: depth + 1])
        effective = getattr(owner, f"get_{child}", None)
        if effective is None:
            continue
        holder, attribute = _owner_of(whole, path)
        changed = _another(getattr(holder, attribute))
        setattr(holder, attribute, changed)
        holder, attribute = _owner_of(effective(), path[depth + 1 :])
        if getattr(holder, attribute) != changed:
            return True
    return False


def _another(value: Any) -> Any:
    """Return a value of the same type that differs."""
    members = getattr(type(value), "__members__", None)
    if members:
        return next(member for member in members.values() if member != value)
    return not value if isinstance(value, bool) else value + 1


def _set_run_fields(root: Any, *, threads: int, seed: int) -> None:
    for _, owner in _owners(root):
        for name, value in _scalars(owner):
            # A default of one thread is a deliberate inner loop (RANSAC inside a parallel verification).
            if name in ("num_threads", "num_workers") and value != 1:
                setattr(owner, name, threads)
            elif name == "random_seed":
                setattr(owner, name, seed)
            elif name.endswith("use_gpu"):
                setattr(owner, name, False)


def _owner_of(root: Any, path: AttributePath) -> tuple[Any, str]:
    for name in path[:-1]:
        root = getattr(root, name)
    return root, path[-1]


def _read(root: Any, path: AttributePath) -> OptionValue:
    owner, attribute = _owner_of(root, path)
    return _plain(getattr(owner, attribute))


def _plain(value: Any) -> OptionValue:
    if hasattr(type(value), "__members__"):
        return str(value.name)
    plain: OptionValue = value
    return plain


@contextlib.contextmanager
def _quiet_log() -> Iterator[None]:
    """Keep what check() logs off the terminal; the error says it."""
    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level
