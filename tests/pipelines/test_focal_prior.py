"""Where intrinsics are unknown, the COLMAP pipelines start from the focal length that COLMAP itself reads."""

import numpy as np
import pycolmap
import pytest

from gtf_tune.pipelines import PipelineJob, create_pipeline, with_focal_prior
from gtf_tune.pipelines.colmap.stages import StagedRun
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Camera, ImageSource, Selection, load_sequence
from gtf_tune.testing import FolderStages
from tests.sequence.test_exif import photograph, rational

GLOMAP = create_pipeline("glomap")
CAMERA = Camera("PINHOLE", 320, 240, (300, 300, 160, 120))

KINDS = {
    "equivalent": {"FocalLengthIn35mmFilm": 28, "FocalLength": rational(4.2)},
    "sensor": {
        "FocalLength": rational(18),
        "FocalPlaneXResolution": rational(100),
        "FocalPlaneResolutionUnit": 3,
        "ExifImageWidth": 320,
    },
    "none": {"Orientation": 1},
    "zero": {"FocalLengthIn35mmFilm": 0},
}


def _loaded(folder, selection=None, **tags):
    for number in range(4):
        photograph(folder / f"{number}.jpg", number, size=(320, 240), **tags)
    return load_sequence(folder, selection=selection or Selection())


@pytest.mark.parametrize("kind", KINDS)
def test_the_prior_is_what_colmap_infers(tmp_path, kind):
    sequence = with_focal_prior(_loaded(tmp_path, **KINDS[kind]), GLOMAP)

    inferred = pycolmap.infer_camera_from_image(str(sequence.frames[0].path))

    assert (sequence.focal_prior is not None) == inferred.has_prior_focal_length == (kind in ("equivalent", "sensor"))
    if sequence.focal_prior is not None:
        assert sequence.focal_prior == pytest.approx(inferred.focal_length)


def test_the_prior_follows_the_size_of_the_images(tmp_path):
    sequence = _loaded(tmp_path, Selection(max_image_size=80), FocalLengthIn35mmFilm=28)

    prior = with_focal_prior(sequence, GLOMAP).focal_prior

    assert prior == pytest.approx(28 / 43.27 * np.hypot(80, 60))


def test_other_pipelines_and_known_cameras_have_no_prior(tmp_path):
    sequence = _loaded(tmp_path, FocalLengthIn35mmFilm=28)

    assert with_focal_prior(sequence, create_pipeline("analytic")) is sequence
    assert with_focal_prior(sequence.with_camera(CAMERA), GLOMAP).focal_prior is None


def test_a_run_is_another_one_only_with_a_prior_that_acts(tmp_path):
    sequence = _loaded(tmp_path, FocalLengthIn35mmFilm=28)

    def key(changed):
        return RunRequest(GLOMAP, {}, changed, "clean", 0, 0.0, 0, 1).key

    assert key(sequence.with_prior(300.0)) != key(sequence)
    assert key(sequence.with_prior(300.0)) != key(sequence.with_prior(301.0))
    assert key(sequence.with_prior(300.0).with_camera(CAMERA)) == key(sequence.with_camera(CAMERA))


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV"])
def test_features_are_stored_with_the_camera_that_colmap_makes(tmp_path, model):
    (tmp_path / "images").mkdir()
    sequence = with_focal_prior(_loaded(tmp_path / "images", FocalLengthIn35mmFilm=28), GLOMAP)
    options = pycolmap.ImageReaderOptions()
    options.camera_model = model
    expected = pycolmap.infer_camera_from_image(str(sequence.frames[0].path), options)

    stored = _stored_camera(tmp_path, sequence, model)

    assert (stored.model, stored.has_prior_focal_length) == (expected.model, True)
    np.testing.assert_allclose(stored.params, expected.params)


def test_features_without_a_prior_are_stored_as_before(tmp_path):
    (tmp_path / "images").mkdir()

    stored = _stored_camera(tmp_path, _loaded(tmp_path / "images"), "SIMPLE_RADIAL")

    assert (stored.has_prior_focal_length, stored.focal_length) == (False, 1.2 * 320)


def _stored_camera(folder, sequence, model):
    pipeline = create_pipeline("glomap", {"camera_model": model})
    (folder / "work").mkdir()
    (folder / "stages").mkdir()
    job = PipelineJob(
        images=ImageSource(sequence),
        options={},
        seed=1,
        threads=1,
        workspace=folder / "work",
        stages=FolderStages(folder / "stages"),
    )
    built = pipeline._tree.build({}, threads=1, seed=1)
    database = StagedRun(job, built, pipeline.settings, pipeline.version)._features()
    copied = folder / "copy.db"
    copied.write_bytes(database.read_bytes())
    opened = pycolmap.Database.open(copied)
    (camera,) = opened.read_all_cameras()
    opened.close()
    return camera
