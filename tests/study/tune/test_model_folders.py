"""A report shows the models that were handed over for its study, and no others."""

import json
from pathlib import Path

from gtf_tune.study.tune.handover import model_folders


def handed_over(folder: Path, options: str, *models: str) -> Path:
    for model in models:
        (folder / model / "0").mkdir(parents=True)
    (folder / ".gtf-tune.json").write_text(json.dumps({"study": "photos"}))
    (folder / "options.json").write_text(options)
    (folder / "options-nominal.json").write_text("{}")
    return folder


def test_nominal_and_what_was_adopted_are_shown(tmp_path: Path) -> None:
    folder = handed_over(tmp_path, '{"a": 1}', "sparse", "sparse-nominal")

    found = model_folders(folder, "photos")

    assert found == {"nominal options": tmp_path / "sparse-nominal" / "0", "adopted options": tmp_path / "sparse" / "0"}


def test_one_model_is_shown_once_and_an_unconfirmed_one_is_called_so(tmp_path: Path) -> None:
    folder = handed_over(tmp_path, "{}", "sparse", "sparse-nominal", "sparse-unconfirmed")

    assert list(model_folders(folder, "photos")) == ["nominal options", "best trial, not confirmed"]


def test_models_of_another_study_and_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    folder = handed_over(tmp_path, "{}", "sparse", "sparse-nominal")

    assert model_folders(folder, "other") == {}
    assert model_folders(tmp_path / "nothing", "photos") == {}
