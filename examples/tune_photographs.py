"""Tune photographs: find the options of GLOMAP that are best for the images in a folder.

    python examples/tune_photographs.py photos/

Started again it goes on where it stopped. The study is in gtf-tune.db: `gtf-tune study report photos` writes its
report, `gtf-tune study export photos` its options in COLMAP's own formats.
"""

import logging
import sys
from pathlib import Path

import gtf_tune as gtf

SPACE = {
    "mapper.max_normalized_reproj_error": (1e-4, 1e-1, "log"),
    "mapper.bundle_adjustment.ceres.loss_function_scale": (0.03, 3.0, "log"),
}


def main(photos: str) -> None:
    """Tune, confirm, and write the options, the trials and a figure beside the photographs."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    study = gtf.tune(photos, pipeline="glomap", space=SPACE, trials=20)
    print(study.best.text)
    for option, value in study.best.options.items():
        print(f"{option} = {value}")
    study.plot("options", "max_normalized_reproj_error").write_html(Path(f"{study.name}-options.html"))


if __name__ == "__main__":
    main(*sys.argv[1:] or ("photos/",))
