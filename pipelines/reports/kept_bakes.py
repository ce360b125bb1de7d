"""Kept bakes as JSON."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, JsonValue

from pipelines.takes.kept_bakes import KeptBake


class KeptBakeRow(BaseModel):
    """A kept bake in `v3studio bakes list --json`."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)

    name: str
    chosen: bool
    """Whether it is the take's stream."""

    current: bool
    """Whether it was baked from the take's present training."""

    same_edits: bool
    """Whether it was baked with the take's present edits."""

    kept: str
    """When, UTC, ISO 8601."""

    bytes: int
    frees: int
    """Bytes that are free again after it is removed."""

    bytes_per_frame: float
    psnr_decoded: float | None
    """Mean over the evaluated cameras and frames, dB; null if it was not measured."""

    qp: int | None
    stream: str
    """Folder of the stream."""

    settings: dict[str, JsonValue]
    """Settings that it was made with, by dotted name."""

    @classmethod
    def of(cls, kept: KeptBake) -> KeptBakeRow:
        """The row of a kept bake."""
        return cls(
            name=kept.name,
            chosen=kept.chosen,
            current=kept.current,
            same_edits=kept.same_edits,
            kept=kept.note.kept,
            bytes=kept.bytes,
            frees=kept.frees,
            bytes_per_frame=kept.bytes_per_frame,
            psnr_decoded=kept.psnr,
            qp=kept.qp,
            stream=str(kept.stream),
            settings=kept.settings,
        )
