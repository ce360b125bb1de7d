"""The table of mask sources, from which `capture.masks` selects one for all cameras."""

from collections.abc import Callable
from dataclasses import dataclass

from v3studio.studio.capture.detect import MASK_FOLDERS, folders_named
from v3studio.studio.capture.settings import MaskKind
from v3studio.studio.counts import listed
from v3studio.studio.masks.agreement.source import open_agreed
from v3studio.studio.masks.alpha import open_alpha
from v3studio.studio.masks.chroma_key import open_chroma_key
from v3studio.studio.masks.imported import open_imported
from v3studio.studio.masks.mask_files import open_files
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, MissingMaskSource, open_none
from v3studio.studio.masks.matting_model import open_model
from v3studio.studio.masks.plain_background import open_plain
from v3studio.studio.masks.plates import FEW_FRAMES, open_clean_plate, open_median_background


@dataclass(frozen=True)
class Source:
    """One source of masks."""

    name: MaskKind  # value of `capture.masks`
    # returns the source and a phrase that describes it; None if the capture does not have it. With `required`, it
    # raises a StudioError (`mask.*`) instead of returning None, and also if files of a camera or frame are missing
    open: Callable[[MaskInputs, bool], tuple[MaskSource, str] | None]
    automatic: bool = False  # whether `auto` tries it
    detects: bool = False  # whether it finds the performer in the images, as sensitive as `capture.mask_sensitivity`


SOURCES = (  # in the order in which `auto` tries them
    Source("alpha", open_alpha, automatic=True),
    Source("files", open_files, automatic=True),
    Source("clean_plate", open_clean_plate, automatic=True, detects=True),
    Source("plain", open_plain, automatic=True),
    Source("agreed", open_agreed, automatic=True, detects=True),
    Source("median_background", open_median_background, automatic=True, detects=True),
    Source("chroma_key", open_chroma_key, detects=True),
    Source("model", open_model),
    Source("none", open_none),
)


def open_mask_source(inputs: MaskInputs) -> tuple[MaskSource, str]:
    """The source that `capture.masks` selects, and a sentence that describes it.

    "auto" that finds none gives a `MissingMaskSource`, so that cameras can be calibrated without masks. StudioError:
    `mask.*`: its files are not found, or files for a camera or frame are missing.
    """
    kind = inputs.spec.masks
    if ":" in kind:
        own, words = open_imported(inputs)
        return own, f"Masks: {words}."
    for source in SOURCES:
        if source.name == kind or (kind == "auto" and source.automatic):
            opened = source.open(inputs, kind != "auto")
            if opened is not None:
                auto = f", chosen automatically{_unused(inputs, source.name)}" if kind == "auto" else ""
                return opened[0], f"Masks: {opened[1]}{auto}."
    missing = MissingMaskSource(
        "no alpha channel, mask files, clean plates or plain background, and too few frames to estimate the background "
        f"({inputs.frame_count}; {FEW_FRAMES} are needed)"
    )
    return missing, f"Masks: not found{_unused(inputs, '')}. {missing.message}"


def _unused(inputs: MaskInputs, used: str) -> str:
    """A sentence on folders that seem to have masks, if other masks are `used`."""
    folders = folders_named(inputs.spec.root, MASK_FOLDERS) if used != "files" else []
    if not folders:
        return ""
    names = listed([repr(name) for name in folders])
    return f". The files in {names} are not used: with capture.masks files, they are, or the error says why not"
