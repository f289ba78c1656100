"""Read the camera from Kalibr's calibration, a chain of cameras, where a data set has no other."""

import re
from pathlib import Path

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.layouts.base import GIVE_THE_CAMERA, Intrinsics, naming, one_camera
from gtf_tune.sequence.layouts.cameras.sensor import sensor_camera
from gtf_tune.sequence.layouts.fields import read_yaml

_CAMERA = re.compile(r"cam[0-9]+")


def find_chain(root: Path) -> Path | None:
    """Return the first file that is called as Kalibr calls its results, ``camchain.yaml`` or with a name around it."""
    folders = (root, root / "mav0") if root.is_dir() else (root.parent,)
    found = (path for folder in folders for path in sorted(folder.glob("*camchain*.y*ml")) if path.is_file())
    return next(found, None)


def chain_intrinsics(path: Path, folder: str) -> Intrinsics:
    """Return the camera of a chain that is called like the ``folder`` of the images, otherwise its first.

    Raises
    ------
    SequenceError
        The file cannot be read, or COLMAP has no model of the camera.
    """
    values = read_yaml(path)
    names = [name for name in values.names() if _CAMERA.fullmatch(name)]
    if not names:
        raise SequenceError(f"{path}: expected cameras cam0, cam1, ... as Kalibr writes them; {GIVE_THE_CAMERA}")
    name = folder if folder in names else names[0]
    among = f", {name} of {len(names)} cameras" if len(names) > 1 else ""
    with naming(path):
        return one_camera(sensor_camera(values[name]), f"intrinsics come from {path.name}{among}")
