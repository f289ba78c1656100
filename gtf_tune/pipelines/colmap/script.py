"""Write the Python script that reconstructs a sequence with a configuration, from the original images.

The script is what makes the models that gtf-tune hands over, so it reproduces them by construction.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

from gtf_tune.version import __version__

if TYPE_CHECKING:  # takes OpenCV, which no reader of studies needs
    from gtf_tune.sequence import Camera


@dataclass(frozen=True)
class Photographs:
    """The images of a reconstruction as COLMAP reads them.

    ``folder`` is absolute and ``names`` are relative to it, with slashes. ``cameras`` belong to the images as they are
    stored; ``None`` where the intrinsics are unknown. ``taken_by`` is the position of each image's camera; without it
    the first took all.
    """

    folder: Path
    names: Sequence[str]
    cameras: "Sequence[Camera | None]"
    taken_by: Sequence[int] = ()

    @property
    def intrinsics_known(self) -> bool:
        """Return whether the intrinsics of all cameras are known."""
        return all(self.cameras)

    @property
    def lists(self) -> "dict[str, tuple[Camera | None, list[str]]]":
        """Return the camera and the names of its images by the file that lists them."""
        if len(self.cameras) == 1:
            return {"images.txt": (self.cameras[0], list(self.names))}
        return {
            f"images-{number}.txt": (
                camera,
                [name for name, taken_by in zip(self.names, self.taken_by, strict=True) if taken_by == number - 1],
            )
            for number, camera in enumerate(self.cameras, 1)
        }


@dataclass(frozen=True)
class _Mapper:
    function: str
    options: str
    changes: str


_INCREMENTAL = """{
        **OPTIONS.get("pipeline", {}),
        "mapper": OPTIONS.get("mapper", {}),
        "triangulation": OPTIONS.get("triangulation", {}),
    }"""
_MAPPERS = {
    "glomap": _Mapper(
        "global_mapping",
        "GlobalPipelineOptions",
        '{**OPTIONS.get("pipeline", {}), "mapper": OPTIONS.get("mapper", {})}',
    ),
    "colmap": _Mapper("incremental_mapping", "IncrementalPipelineOptions", _INCREMENTAL),
    "colmap-hierarchical": _Mapper(
        "hierarchical_mapping",
        "HierarchicalPipelineOptions",
        f"""{{
        **OPTIONS.get("hierarchical", {{}}),
        "clustering_options": OPTIONS.get("clustering", {{}}),
        "incremental_options": {_INCREMENTAL},
    }}""",
    ),
}
_CALIBRATION = """\
    view_graph = configured("ViewGraphCalibrationOptions", OPTIONS.get("view_graph", {}))
    if not pycolmap.calibrate_view_graph(database, view_graph):
        sys.exit("the focal length cannot be estimated from these images")
"""


def pycolmap_script(
    pipeline: str, photographs: Photographs, settings: Mapping[str, object], version: str, *, seed: int = 0
) -> str:
    """Return the text of ``run.py``, which reads ``options.json`` and ``images.txt`` beside it.

    ``settings`` are those of the pipeline in the study, ``version`` is that of pycolmap.
    """
    mapper = _MAPPERS[pipeline]
    pairing = str(settings.get("pairing", "exhaustive"))
    tree = str(settings.get("vocab_tree_path", ""))
    calibrates = pipeline == "glomap" and not photographs.intrinsics_known
    text = files("gtf_tune.pipelines.colmap").joinpath("run_script.txt").read_text(encoding="utf-8")
    return Template(text).substitute(
        gtf_tune=__version__,
        pycolmap=version,
        images=_literal(str(photographs.folder)),
        seed=seed,
        cameras=_cameras(photographs, str(settings.get("camera_model", "SIMPLE_RADIAL"))),
        pairing=_literal(pairing),
        pairing_kind=_literal(f"{pairing.title()}PairingOptions"),
        pairing_more=f"pairing.vocab_tree_path = {_literal(tree)}\n" if tree and pairing == "sequential" else "",
        match=f"match_{pairing}",
        device=settings.get("device", "cpu"),
        calibration=_CALIBRATION if calibrates else "",
        map=mapper.function,
        mapping_kind=mapper.options,
        mapping_options=mapper.changes,
    )


def _cameras(photographs: Photographs, usual_model: str) -> str:
    """Return the lines of the script's cameras: the list of a camera's images, its model and its parameters."""
    lines = []
    for file, (camera, _) in photographs.lists.items():
        params = ",".join(map(repr, camera.params)) if camera else ""
        values = (_literal(file), _literal(camera.model if camera else usual_model), _literal(params))
        lines.append(f"    ({', '.join(values)}),")
    return "\n".join(lines)


def _literal(text: str) -> str:
    """Return text as a Python literal between double quotes."""
    return '"' + repr(text)[1:-1].replace('"', r"\"").replace(r"\'", "'") + '"'
