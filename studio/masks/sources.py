"""The table of mask sources, from which `capture.masks` selects one, or several that are evidence for all cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from v3studio.studio.capture.detect import MASK_FOLDERS, folders_named
from v3studio.studio.capture.settings import MaskKind
from v3studio.studio.counts import listed
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.agreement.source import AgreedMaskSource, open_agreed
from v3studio.studio.masks.alpha import AlphaMaskSource, open_alpha
from v3studio.studio.masks.chroma_key import ChromaMaskSource, open_chroma_key
from v3studio.studio.masks.imported import open_imported
from v3studio.studio.masks.mask_files import open_files
from v3studio.studio.masks.mask_source import (
    FullMaskSource,
    MaskInputs,
    MaskSource,
    MissingMaskSource,
    Recolors,
    open_none,
)
from v3studio.studio.masks.matting_model import open_model
from v3studio.studio.masks.plain_background import PlainMaskSource, open_plain
from v3studio.studio.masks.plates import FEW_FRAMES, PlateMaskSource, open_clean_plate, open_median_background


@dataclass(frozen=True)
class Source:
    """One source of masks."""

    name: MaskKind  # value of `capture.masks`
    # returns the source and a phrase that describes it; None if the capture does not have it. With `required`, it
    # raises a StudioError (`mask.*`) instead of returning None, and also if files of a camera or frame are missing
    open: Callable[[MaskInputs, bool], tuple[MaskSource, str] | None]
    # what `auto` does with it: takes it if there is no evidence before it in the table, combines it with other
    # evidence, or does so only if none of the background is before it
    automatic: Literal["alone", "evidence", "instead", ""] = ""
    detects: bool = False  # whether it finds the performer in the images, as sensitive as `capture.mask_sensitivity`


SOURCES = (  # in the order in which `auto` tries them
    Source("alpha", open_alpha, "alone"),
    Source("files", open_files, "alone"),
    Source("clean_plate", open_clean_plate, "evidence", detects=True),
    Source("plain", open_plain, "alone"),
    Source("chroma_key", open_chroma_key, "evidence", detects=True),
    Source("median_background", open_median_background, "instead", detects=True),
    Source("model", open_model, "evidence"),
    Source("none", open_none),
)

Opened = dict[str, tuple[MaskSource, str]]
"""Sources and the phrases that describe them, by name."""


def open_mask_source(inputs: MaskInputs) -> tuple[MaskSource, str]:
    """The source that `capture.masks` selects, and a sentence that describes it.

    "auto" that finds none gives a `MissingMaskSource`, so that cameras can be calibrated without masks. StudioError:
    `mask.*`: its files are not found, or files for a camera or frame are missing.
    """
    kind = inputs.spec.masks
    if kind == "auto":
        return _automatic(inputs)
    names = (kind,) if isinstance(kind, str) else kind
    opened: Opened = {name: _required(inputs, name) for name in names}
    source, phrase = opened[names[0]] if isinstance(kind, str) else open_agreed(inputs, opened)
    return source, f"Masks: {phrase}."


_OWN_SET = (
    FullMaskSource, AlphaMaskSource, PlainMaskSource, ChromaMaskSource, MissingMaskSource, Recolors, PlateMaskSource
)  # fmt: skip
"""Sources whose footage shows no set, which change its colors, or which know it."""


def given_plates(inputs: MaskInputs, masks: MaskSource) -> PlateMaskSource | None:
    """The clean plates of a capture whose masks are not from them; None if there are none, or footage shows no set.
    Raises StudioError: those that are set are not found, or some cameras have none."""
    if isinstance(masks, _OWN_SET) or (isinstance(masks, AgreedMaskSource) and masks.has_plates):
        return None
    try:
        opened = open_clean_plate(inputs, False)
    except StudioError as error:
        if error.code == "mask.plate_missing" and inputs.spec.clean_plates == "auto":
            return None  # a folder of that name with other images
        raise
    return None if opened is None else opened[0]


def _required(inputs: MaskInputs, name: str) -> tuple[MaskSource, str]:
    if ":" in name:
        return open_imported(name)
    opened = next(source for source in SOURCES if source.name == name).open(inputs, True)
    assert opened is not None
    return opened


def _automatic(inputs: MaskInputs) -> tuple[MaskSource, str]:
    evidence: Opened = {}
    for source in SOURCES:
        if not source.automatic or (evidence and source.automatic == "alone"):
            continue
        if source.automatic == "instead" and "clean_plate" in evidence:
            continue
        opened = source.open(inputs, False)
        if opened is not None and source.automatic == "alone":
            return opened[0], f"Masks: {opened[1]}, chosen automatically{_unused(inputs, source.name)}."
        if opened is not None:
            evidence[source.name] = opened
    if evidence and (inputs.can_vote or set(evidence) != {"model"}):
        agreed, phrase = open_agreed(inputs, evidence)
        return agreed, f"Masks: {phrase}, chosen automatically{_unused(inputs, '')}."
    missing = MissingMaskSource(
        "no alpha channel, mask files, clean plates, plain background or screen, and too few frames to estimate the "
        f"background ({inputs.frame_count}; {FEW_FRAMES} are needed)"
        + ("; with cameras, three or more can agree on what a matting model sees" if evidence else "")
    )
    return missing, f"Masks: not found{_unused(inputs, '')}. {missing.message}"


def _unused(inputs: MaskInputs, used: str) -> str:
    """A sentence on folders that seem to have masks, if other masks are `used`."""
    folders = folders_named(inputs.spec.root, MASK_FOLDERS) if used != "files" else []
    if not folders:
        return ""
    names = listed([repr(name) for name in folders])
    return f". The files in {names} are not used: with capture.masks files, they are, or the error says why not"
