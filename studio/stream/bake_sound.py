"""Bakes the sound of a stream of version 3."""

from __future__ import annotations

import os
from pathlib import Path

from studio.atomic_files import temporary_path
from studio.audio import SAMPLE_RATE, Cut, encode_sound
from studio.errors import StudioError
from studio.stream.bake_ladder import content_name
from studio.stream.ladder_models import FILES, AudioEntry


def bake_sound(cut: Cut, directory: Path) -> AudioEntry:
    """Encode a sound into `directory/files`, under the name of its content. The same sound gives the same bytes.

    Args:
        cut: the sound, as long as the stream's frames.
        directory: the stream's folder; created if missing.

    Returns:
        The entry for the manifest. `cut` then knows how much of it is silence (`missing_before`, `missing_after`).

    Raises:
        StudioError: the sound cannot be read, or the file cannot be written.
    """
    folder = directory / FILES
    partial = temporary_path(folder / "sound")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        samples = encode_sound(cut.blocks(), str(partial), SAMPLE_RATE, cut.channels)
        data = partial.read_bytes()
        path, digest = content_name(data, ".m4a")
        os.replace(partial, directory / path)
    except OSError as error:
        raise StudioError(
            "bake.write_failed", f"the sound cannot be written ({error.strerror or error})", file=partial
        ) from None
    finally:
        partial.unlink(missing_ok=True)
    return AudioEntry(
        path=path,
        bytes=len(data),
        sha256=digest,
        codec="aac",
        sample_rate=SAMPLE_RATE,
        channels=cut.channels,
        samples=samples,
        start=0.0,
    )
