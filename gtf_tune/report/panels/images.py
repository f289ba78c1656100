"""The images themselves, each with how far its frame moves under noise: a bad photograph is seen at once."""

import base64
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gtf_tune.display import significant
from gtf_tune.errors import SequenceError
from gtf_tune.report.aligned_runs import ConfigurationRuns
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.panels.frames import FrameSpread, frame_spread
from gtf_tune.report.study_data import StudyData
from gtf_tune.sequence import Frame
from gtf_tune.sequence import Sequence as Images
from gtf_tune.study.open_study import folder_of, load_stored_images

_WIDTH_PX = 180
_JPEG_QUALITY = 70
_MOST_IMAGES = 24
_MOST_SEQUENCES = 4


@dataclass(frozen=True)
class Thumbnail:
    """One image of a contact sheet.

    ``moved`` is in per mille of the extent, NaN where no run registered the frame; ``registered`` is the share of runs
    that did, ``is_fragile`` marks frames that move far more than others.
    """

    frame: Frame
    moved: float
    registered: float
    is_fragile: bool


def contact_sheet(images: Images, spread: FrameSpread, most: int = _MOST_IMAGES) -> tuple[Thumbnail, ...]:
    """Return at most ``most`` frames in their order: the fragile ones first of all, the others evenly spread."""
    rows = {int(frame_id): row for row, frame_id in enumerate(spread.frame_ids)}
    found = [_thumbnail(frame, rows.get(frame.frame_id), spread) for frame in images.frames]
    fragile = sorted((each for each in found if each.is_fragile), key=lambda each: -each.moved)[: most // 2]
    others = [each for each in found if each not in fragile]
    count = min(most - len(fragile), len(others))
    even = [others[place] for place in np.linspace(0, len(others) - 1, count).round().astype(int)] if count else []
    return tuple(sorted((*fragile, *even), key=lambda each: each.frame.frame_id))


def images_panel(report: ReportInput) -> list[Block]:
    """Return a contact sheet of each of the first sequences."""
    if not report.configurations:
        return [markup.missing("No run has finished yet, so nothing is known about single images.")]
    return [
        _sheet(report.data, name, configurations[-1])
        for name, configurations in list(report.configurations.items())[:_MOST_SEQUENCES]
    ]


def _thumbnail(frame: Frame, row: int | None, spread: FrameSpread) -> Thumbnail:
    if row is None:
        return Thumbnail(frame, float("nan"), 0.0, is_fragile=False)
    return Thumbnail(frame, float(spread.median[row]), float(spread.registered[row]), bool(spread.fragile[row]))


def _sheet(data: StudyData, name: str, runs: ConfigurationRuns) -> Html:
    stored = next(sequence for sequence in data.sequences if sequence.name == name)
    defined = next(sequence for sequence in data.definition.sequences if sequence.name == name)
    try:
        images = load_stored_images(defined, stored, folder_of(defined, Path(data.study.root), {}))
        chosen = contact_sheet(images, frame_spread(runs))
        pictures = [_jpeg(images, thumbnail.frame) for thumbnail in chosen]
    except SequenceError as error:
        return markup.missing(f"{name}: the images cannot be shown ({error}).")
    highest = max((thumbnail.moved for thumbnail in chosen if np.isfinite(thumbnail.moved)), default=1.0) or 1.0
    cells = [_picture(name, *pair, highest) for pair in zip(chosen, pictures, strict=True)]
    title = markup.element("h3", markup.text(f"{name}, {runs.title}: {len(chosen)} of {len(images)} images"))
    return markup.joined([title, markup.element("div", *cells, class_="sheet")])


def _jpeg(images: Images, frame: Frame) -> bytes:
    grey = images.read_grey(frame)
    height = max(round(grey.shape[0] * _WIDTH_PX / grey.shape[1]), 1)
    small = cv2.resize(grey, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])


def _picture(sequence: str, thumbnail: Thumbnail, jpeg: bytes, highest: float) -> Html:
    words = _words(thumbnail)
    image = markup.image(
        f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}",
        f"{sequence}, frame {thumbnail.frame.frame_id}: {words} ({thumbnail.frame.path.name})",
    )
    caption = markup.element("figcaption", markup.text(f"{thumbnail.frame.frame_id}: {words}"))
    colour = theme.sampled(theme.ERROR_SCALE, [thumbnail.moved / highest])[0] if thumbnail.registered else theme.FAINT
    return markup.element("figure", image, caption, style=f"border-color:{colour}")


def _words(thumbnail: Thumbnail) -> str:
    if not thumbnail.registered:
        return "not registered"
    moved = f"{significant(thumbnail.moved, 2)} ‰" if np.isfinite(thumbnail.moved) else "movement unknown"
    partly = "" if thumbnail.registered == 1 else f", in {100 * thumbnail.registered:.0f} % of the runs"
    return f"{moved}{partly}"


PANEL = Panel(
    "Images",
    images_panel,
    "Under each image: its frame, and how far that frame moves under noise, in per mille of the extent. Red borders "
    "mark those that move most; frames that move far more than others are always among the images.",
)
