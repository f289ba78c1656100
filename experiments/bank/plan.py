"""What the bank holds: sequences in light forms, configurations, copies, and the order in which runs are made."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunKind
from gtf_tune.sequence import Selection
from gtf_tune.sequence.render.room import RoomSpec

CLEAN_RUNS = 4
SIGMAS = (0.5, 2.0)
"""Levels of noise in grey levels; the copies of one index have the same noise pattern on both."""

NOISY_RUNS = (16, 8)
"""Copies on each level."""

FIXED: Mapping[str, OptionValue] = MappingProxyType(
    {
        "mapper.bundle_adjustment.refine_focal_length": False,
        "mapper.bundle_adjustment.refine_extra_params": False,
        "extraction.sift.max_num_features": 1000,
    }
)
"""Intrinsics are known and held fixed; fewer features than the default of 8192 keep runs affordable."""

HUBER = "mapper.bundle_adjustment.ceres.loss_function_scale"
BA = "mapper.max_normalized_reproj_error"
TWO_VIEW = "verification.ransac.max_error"
PRESET: Mapping[str, OptionValue] = MappingProxyType(
    {TWO_VIEW: 1.0, "verification.min_num_inliers": 30, "verification.min_inlier_ratio": 0.25}
)
"""What `colmap automatic_reconstructor` sets for global mapping."""

NOMINAL = "nominal"


def _configurations() -> dict[str, Mapping[str, OptionValue]]:
    found: dict[str, Mapping[str, OptionValue]] = {NOMINAL: {}}

    def add(huber: float | None = None, ba: float | None = None, two_view: float | None = None) -> None:
        given = {HUBER: (huber, "huber"), BA: (ba, "ba"), TWO_VIEW: (two_view, "two-view")}
        named = {option: pair for option, pair in given.items() if pair[0] is not None}
        label = " ".join(f"{short} {value:g}" for value, short in named.values() if value is not None)
        found[label] = {option: value for option, (value, _) in named.items() if value is not None}

    for scale in (0.1, 0.2, 0.05, 0.5):
        add(huber=scale)
    add(ba=0.004)
    add(ba=0.002)
    add(huber=0.1, ba=0.004)
    found["preset"] = PRESET
    found["preset huber 0.1"] = {**PRESET, HUBER: 0.1}
    for scale, threshold in ((0.2, 0.004), (0.05, 0.004), (0.1, 0.002), (0.2, 0.002), (0.5, 0.004)):
        add(huber=scale, ba=threshold)
    for scale in (0.03, 0.07, 0.3, 2.0):
        add(huber=scale)
    for threshold in (0.001, 0.003, 0.006, 0.02):
        add(ba=threshold)
    for error in (1.0, 2.0, 8.0):
        add(two_view=error)
    add(huber=0.1, two_view=2.0)
    add(huber=0.05, ba=0.002)
    found["preset ba 0.004"] = {**PRESET, BA: 0.004}
    found["preset huber 0.1 ba 0.004"] = {**PRESET, HUBER: 0.1, BA: 0.004}
    return found


CONFIGURATIONS: Mapping[str, Mapping[str, OptionValue]] = MappingProxyType(_configurations())
"""Options besides the fixed ones by label, the most valuable configurations first."""


_WHOLE = Selection()


@dataclass(frozen=True)
class BankSequence:
    """Light form of one sequence, and the group of sequences whose errors are not independent of it.

    ``room`` describes how it is rendered; a sequence without one is read from a folder of that name.
    """

    name: str
    selection: Selection = _WHOLE
    group: str = ""
    room: RoomSpec | None = None

    @property
    def grouped(self) -> str:
        return self.group or self.name


def _room(number: int, spec: RoomSpec) -> BankSequence:
    return BankSequence(f"room-{number}", room=spec)


SEQUENCES: tuple[BankSequence, ...] = (
    BankSequence("fountain-P11", Selection(max_image_size=640)),
    BankSequence("hut", Selection(max_frames=18, max_image_size=600)),
    BankSequence("dtu-scan24", Selection(max_frames=20), "dtu"),
    BankSequence("dtu-scan37", Selection(max_frames=20, max_image_size=480), "dtu"),
    BankSequence("kitti07", Selection(stop=40, stride=2, max_image_size=800), "kitti"),
    BankSequence("kitti06", Selection(max_frames=20, max_image_size=620), "kitti"),
    BankSequence("kitti00-turn", Selection(max_frames=16, max_image_size=620), "kitti"),
    BankSequence("new-tsukuba", Selection(stride=2, max_frames=18, max_image_size=480)),
    BankSequence("nerf-lego", Selection(stride=2, max_frames=20, max_image_size=480)),
    BankSequence("tum-fr3-office", Selection(max_image_size=560)),
    _room(0, RoomSpec(14, 320, 240, seed=10)),
    _room(1, RoomSpec(16, 400, 300, seed=11, motion="forward")),
    _room(2, RoomSpec(16, 360, 270, seed=12, motion="turn")),
    _room(3, RoomSpec(18, 400, 300, seed=13, contrast=0.5)),
    _room(4, RoomSpec(12, 480, 360, seed=14, motion="forward", contrast=0.7, sensor_noise=1.5)),
    _room(5, RoomSpec(20, 320, 240, seed=15, motion="turn", contrast=1.3)),
    _room(6, RoomSpec(12, 360, 270, seed=16, exposure=0.15)),
    _room(7, RoomSpec(20, 360, 270, seed=17, motion="forward", sensor_noise=5.0)),
    _room(8, RoomSpec(18, 400, 300, seed=18, motion="turn", contrast=0.6, sensor_noise=1.0)),
    _room(9, RoomSpec(16, 480, 360, seed=19, contrast=0.35, sensor_noise=2.0, flicker=0.15)),
)


@dataclass(frozen=True, order=True)
class Copy:
    """One copy of the images of a sequence with its seed: a clean run, or a noisy one of a level."""

    kind: RunKind
    index: int
    sigma: float


class Batch(NamedTuple):
    """Configurations, by label, that are run on one copy of one sequence one after the other."""

    sequence: BankSequence
    copy: Copy
    labels: tuple[str, ...]


def copies(clean: int, noisy: int, noisier: int = 0) -> list[Copy]:
    """Return copies in an order of which any beginning can be replayed: clean and noisy ones in turns."""
    weak, strong = SIGMAS
    counted = [(2.0 * index, Copy("clean", index, 0.0)) for index in range(clean)]
    counted += [(index + 0.5, Copy("noisy", index, weak)) for index in range(noisy)]
    counted += [(index + 0.7, Copy("noisy", index, strong)) for index in range(noisier)]
    return [copy for _, copy in sorted(counted)]


FIRST: tuple[str, ...] = (
    *("dtu-scan24", "room-0", "fountain-P11", "room-2", "nerf-lego"),
    *("room-6", "kitti00-turn", "room-1", "dtu-scan37", "room-5"),
)
"""Sequences whose runs take the fewest seconds: they are filled first, so that something can be replayed soon."""

_ROUNDS = (
    (5, (2, 4, 0)),
    (5, (2, 12, 0)),
    (8, (4, 8, 0)),
    (8, (4, 16, 0)),
    (10, (4, 8, 4)),
    (len(CONFIGURATIONS), (4, 16, 8)),
)
"""How many of the configurations are run on how many copies: clean, noisy, noisier."""


def batches() -> Iterator[Batch]:
    """Yield all batches in the order of work; a later one may repeat runs of an earlier one, which are stored."""
    by_name = {sequence.name: sequence for sequence in SEQUENCES}
    yield from _round([by_name[name] for name in FIRST], *_ROUNDS[0])
    for configurations, counts in _ROUNDS:
        yield from _round(SEQUENCES, configurations, counts)


def _round(sequences: Sequence[BankSequence], configurations: int, counts: tuple[int, int, int]) -> Iterator[Batch]:
    for copy in copies(*counts):
        for sequence in sequences:
            yield Batch(sequence, copy, tuple(CONFIGURATIONS)[:configurations])
