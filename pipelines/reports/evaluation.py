"""The HTML report of a take: one file with embedded images and plots."""

import base64
import datetime
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from v3studio.pipelines.config import Config
from v3studio.pipelines.reports.images import encode
from v3studio.pipelines.reports.page import rendered
from v3studio.pipelines.reports.plots import plots
from v3studio.pipelines.reports.tables import metric_texts
from v3studio.pipelines.takes.authored.marks import read_marks
from v3studio.pipelines.takes.files.digests import digest_of
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.evaluation import Evaluation, read_evaluation
from v3studio.pipelines.takes.results.records import note_rewritten, read_record
from v3studio.pipelines.takes.results.stage_files import StoredCard, read_cameras_report
from v3studio.pipelines.takes.results.summaries import summary_words
from v3studio.pipelines.takes.take import Take
from v3studio.pipelines.version import program_version
from v3studio.studio.atomic_files import write_text
from v3studio.studio.comparison.metrics import FLICKER
from v3studio.studio.errors import StudioError

_BEGIN, _END = "<!-- over time -->", "<!-- end of over time -->"

_IMAGE_WIDTH = 420  # largest width of an image in pixels
DIFFERENCE_GAIN = 4.0  # differences are amplified by this factor to make them visible


def render_report(
    take: Take,
    config: Config,
    groups: Sequence[Group],
    evaluation: Evaluation,
    samples: Sequence[Mapping[str, str]],
    stages: Sequence[str],
) -> str:
    """`samples`: from `sample_images`. `stages`: those before the evaluation."""
    return rendered(
        "report.html.j2",
        title=take.root.name,
        made=datetime.datetime.now().isoformat(sep=" ", timespec="minutes"),
        version=program_version(),
        evaluation=evaluation,
        protocol=evaluation.protocol.to_json(),
        figures=_figures(evaluation),
        titles=[f"{metric.title} {what}" for metric in evaluation.metrics for what in ("trained", "decoded")],
        texts=partial(metric_texts, metrics=evaluation.metrics),
        gain=DIFFERENCE_GAIN,
        samples=samples,
        over_time=_over_time(take, groups, evaluation),
        calibration=_calibration(take),
        timings=_timings(take, stages),
        card=_card(take),
        settings=config.model_dump(mode="json"),
    )


def _card(take: Take) -> tuple[StoredCard, str] | None:
    """The take's card, and its image as a data URI; None if it was not measured."""
    if not (take.card.is_file() and take.card_picture.is_file()):
        return None
    return read_model(take.card, StoredCard), _data_uri(take.card_picture.read_bytes())


def _figures(evaluation: Evaluation) -> list[tuple[str, str]]:
    """The means at the top of the report: titles and values."""
    summary = evaluation.summary
    found = [
        (f"{metric.title} {what}", metric.text(summary.measures[f"{metric.name}_{what}"]))
        for metric in evaluation.metrics
        for what in ("trained", "decoded")
    ]
    borders = summary.flicker_at_group_borders
    for title, value in (("Flicker", summary.flicker), ("Flicker at group borders", borders)):
        found += [] if value is None else [(title, FLICKER.text(value, unit=False))]
    return found


def update_marks(take: Take, groups: Sequence[Group]) -> bool:
    """Update the marks in the report without measuring again; returns whether it changed."""
    if not (take.report.is_file() and take.evaluation.is_file()):
        problem = "no report yet"
        raise StudioError("take.no_report", problem, file=take.root, fix="Run `v3studio evaluate`.", stage="evaluate")
    text = take.report.read_text(encoding="utf-8")
    head, begin, rest = text.partition(_BEGIN)
    _, end, tail = rest.partition(_END)
    if not (begin and end):
        problem = "the report has no place for marks"
        fix = f"Run `v3studio evaluate --take {take.root} --force`."
        raise StudioError("take.damaged", problem, file=take.report, fix=fix, stage="evaluate")
    if _note_of(*_marks(take)) in text:
        return False  # plotting of a long take takes seconds
    write_text(take.report, head + _over_time(take, groups, read_evaluation(take.evaluation)) + tail)
    note_rewritten(take, "evaluate")
    return True


def _over_time(take: Take, groups: Sequence[Group], evaluation: Evaluation) -> str:
    """The part of the report with the marks, between two comments."""
    marks, error = _marks(take)
    body = rendered(
        "over_time.html.j2",
        plots=plots(take, groups, evaluation, marks),
        marks=sorted(marks.items()),
        rows={row.frame: row for row in evaluation.frames},
        marks_error=error,
    )
    return f"{_BEGIN}\n{_note_of(marks, error)}\n{body}\n{_END}"


def _marks(take: Take) -> tuple[dict[int, str], str]:
    """Notes by frame; and why they cannot be read, with which the report is written, too."""
    try:
        return {frame: mark.words for frame, mark in read_marks(take.marks).items()}, ""
    except StudioError as found:
        return {}, str(found)


def _note_of(marks: dict[int, str], error: str) -> str:
    """A comment in the report by which its marks are recognized."""
    return f"<!-- marks {digest_of([sorted(marks.items()), error])} -->"


def sample_images(view: str, images: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Images of a view, with the difference, as data URIs by label. `images`: footage, trained and decoded, cropped to
    the same box, (h, w, 3) float32 in 0 to 1; `view`: begins the labels."""
    difference = np.clip(np.abs(images["decoded"] - images["footage"]) * DIFFERENCE_GAIN, 0, 1)
    shown = {**images, f"difference x{DIFFERENCE_GAIN:g}": difference}
    return {f"{view}: {name}": _embedded(image) for name, image in shown.items()}


def _embedded(image: np.ndarray) -> str:
    """A data URI, at most `_IMAGE_WIDTH` pixels wide."""
    import cv2

    if image.shape[1] > _IMAGE_WIDTH:
        size = (_IMAGE_WIDTH, max(1, round(image.shape[0] * _IMAGE_WIDTH / image.shape[1])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return _data_uri(encode(image, ".jpg"))


def _data_uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def _calibration(take: Take) -> dict[str, str | float]:
    """Scalars of the calibration report; tables per camera are only in calibrate/report.json."""
    report = read_cameras_report(take)
    found: dict[str, str | float] = {}
    for name, value in report.model_dump(exclude_unset=True).items() if report is not None else ():
        if isinstance(value, dict) and len(value) <= 4:
            found |= {f"{name} {key}": item for key, item in value.items() if isinstance(item, (int, float))}
        elif isinstance(value, (str, int, float)):
            found[name] = value
    return found


def _timings(take: Take, stages: Sequence[str]) -> list[tuple[str, float, str]]:
    """The duration in seconds and the main figures of each stage."""
    rows = []
    for stage in stages:
        record = read_record(take, stage)
        if record is not None and record.seconds is not None:
            rows.append((stage, record.seconds, summary_words(stage, record.summary)))
    return rows
