"""Make the models that are handed over, each in a process of its own, by the script that is handed over with them."""

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gtf_tune.errors import RunError
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.study.outcome.export import option_json

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.models import SparseModel

MARK = ".gtf-tune.json"
"""File by which an output folder is known to be ours, so that it may be replaced."""

MATCHES = "matches-*.db"
_LOG_LINES = 3
_REFINED = ("refine_focal_length", "refine_extra_params", "refine_principal_point")


@dataclass(frozen=True)
class Reconstructed:
    """A model, and the seconds that it took: all, and those of mapping alone."""

    model: "SparseModel"
    whole_s: float
    mapping_s: float


class TooSlow(RunError):
    """Signal that a reconstruction was ended because it took longer than it may."""


@dataclass
class Workshop:
    """Make models of one sequence in a folder that is not handed over yet; ``timeout_s`` bounds each of them.

    ``study`` is the study that they are made for.
    """

    sequence: Sequence
    pipeline: Pipeline
    announce: Callable[[str], None] = lambda _: None
    timeout_s: float | None = None
    mark: dict[str, str] = field(default_factory=dict)
    study: str = ""

    def nominal(self, work: Path, folder: Path, options: Mapping[str, OptionValue]) -> Reconstructed:
        """Return the nominal model: that of an earlier handover where it is the same, else a new one."""
        from gtf_tune.pipelines.colmap.models import read_model

        scripts = [work / "run.py", *sorted(work.glob("images*.txt")), work / "options-nominal.json"]
        made_by = [path.read_text(encoding="utf-8", errors="surrogateescape") for path in scripts]
        key = hashlib.sha256("\0".join(made_by).encode(errors="surrogateescape")).hexdigest()
        made_for = {"study": self.study, "sequence": self.sequence.name, "pipeline": self.pipeline.name}
        self.mark = {**made_for, "nominal": key}
        known = json.loads((folder / MARK).read_text() or "{}") if (folder / MARK).is_file() else {}
        if known.get("nominal") != key or not (folder / "sparse-nominal" / "0").is_dir():
            self.announce(f"reconstructing {len(self.sequence)} images with the nominal options")
            return self.reconstruct(work, "sparse-nominal", options)
        shutil.copytree(folder / "sparse-nominal", work / "sparse-nominal")
        for matches in folder.glob(MATCHES):
            shutil.copyfile(matches, work / matches.name)
        _, names = common_folder(self.sequence)
        model = read_model(work / "sparse-nominal" / "0", names)
        return Reconstructed(model, known["whole_s"], known["mapping_s"])

    def in_time(self, needed_s: float) -> "Workshop":
        """Return this workshop where there is time for another model, and announce its making.

        Raises
        ------
        TooSlow
            There is not.
        """
        if self.timeout_s is not None and needed_s > self.timeout_s:
            raise TooSlow(
                f"there was no time left for a reconstruction of about {needed_s:.0f} s; 'gtf-tune study export NAME' "
                "writes the scripts that make it"
            )
        self.announce(f"reconstructing {len(self.sequence)} images with the options of the best trial")
        return self

    def moved_by_calibration(self, work: Path, model: "SparseModel", options: Mapping[str, OptionValue]) -> float:
        """Return how far the trajectory moves where the intrinsics are refined too, as a fraction of the extent.

        NaN where the pipeline cannot refine them, or the reconstruction fails.
        """
        from gtf_tune.metrics import AteSettings, pairwise_matrix

        free = {name: True for name in self.pipeline.options.specs if name.endswith(_REFINED)}
        if not free:
            return math.nan
        try:
            other = self.reconstruct(work, "sparse-refined", {**options, **free}).model
        except RunError:
            return math.nan
        found = pairwise_matrix([model.trajectory], [other.trajectory], AteSettings("sim3"))
        return float(found.errors[0, 0] / found.extents[0, 0])

    def reconstruct(self, work: Path, name: str, options: Mapping[str, OptionValue]) -> Reconstructed:
        """Run the script in a process of its own, on the matches of an earlier call where they are the same."""
        from gtf_tune.pipelines.colmap.models import read_model

        options = {**options, **size_option(self.sequence)}
        write_text(work / f"{name}.json", option_json(options))
        log, database = work / f"{name}.log", _matches_file(work, options)
        began = time.time()
        with log.open("wb") as output:
            try:
                done = subprocess.run(
                    [sys.executable, "run.py", name, f"{name}.json", database.name],
                    cwd=work,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    check=False,
                    timeout=self.timeout_s,
                )
            except subprocess.TimeoutExpired as error:
                raise TooSlow(f"a reconstruction takes longer than {error.timeout:.0f} s") from None
        (work / f"{name}.json").unlink()
        if done.returncode:
            last = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-_LOG_LINES:]
            reason = " / ".join(last) or f"exit code {done.returncode}"
            raise RunError(f"the reconstruction in {name} failed: {reason}")
        ended = time.time()
        mapping_s = ended - min(max(database.stat().st_mtime, began), ended)
        _, names = common_folder(self.sequence)
        return Reconstructed(read_model(work / name / "0", names), ended - began, mapping_s)


def size_option(sequence: Sequence) -> dict[str, OptionValue]:
    """Return the option by which COLMAP reduces the images to the size of the sequence; nothing at full size."""
    reduced = any(camera.size != camera.stored_size for camera in sequence.cameras)
    return {"extraction.max_image_size": sequence.longest_side} if reduced else {}


def contradicted(adopted: "SparseModel", nominal: "SparseModel") -> str:
    """Return how the adopted configuration contradicts nominal on the whole sequence; empty where it does not."""
    from gtf_tune.study.outcome.contradiction import CleanRun, contradictions

    both = [
        CleanRun(model.trajectory, float(model.num_points), model.mean_track_length) for model in (nominal, adopted)
    ]
    found = contradictions(both[:1], both[1:], explained=0.0)
    return f"on all images the adopted configuration {found[0]}" if found else ""


def common_folder(sequence: Sequence) -> tuple[Path, dict[str, tuple[int, float]]]:
    """Return the folder that holds all images, and frame id and timestamp by the name below it."""
    folder = Path(os.path.commonpath([frame.path.absolute().parent for frame in sequence.frames]))
    names = {
        frame.path.absolute().relative_to(folder).as_posix(): (frame.frame_id, frame.timestamp)
        for frame in sequence.frames
    }
    return folder, names


def _matches_file(work: Path, options: Mapping[str, OptionValue]) -> Path:
    """Return the database of features and verified matches that options lead to.

    Where only that of another verification is there, it is taken over without its verified pairs.
    """
    from gtf_tune.pipelines.colmap.database import copy_database

    matched = _key(options, ("extraction.", "matching.", "exhaustive.", "sequential."))
    file = work / MATCHES.replace("*", f"{matched}-{_key(options, ('verification.',))}")
    other = next(work.glob(MATCHES.replace("*", f"{matched}-*")), None)
    if other is not None and not file.exists():
        copy_database(other, file, without={"two_view_geometries"})
    return file


def _key(options: Mapping[str, OptionValue], groups: tuple[str, ...]) -> str:
    relevant = {name: value for name, value in sorted(options.items()) if name.startswith(groups)}
    return hashlib.sha256(json.dumps(relevant).encode()).hexdigest()[:12]


def write_text(path: Path, text: str) -> None:
    """Write a text whose names of files may not be UTF-8."""
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
