"""What sharing would take, told before it is done."""

from __future__ import annotations

from pipelines.share.player_files import read_player
from pipelines.share.results import ShareSize
from pipelines.share.single_file import MAX_SINGLE_FILE_BYTES
from pipelines.share.stream_files import stream_to_share


def share_size(source: str) -> ShareSize:
    """Sizes of a take's or a stream's share, without the poster (some 50 to 150 kB).

    Raises:
        StudioError: no stream there, or the player is not built.
    """
    player = read_player().size
    with stream_to_share(source) as stream:
        total = stream.total_bytes
        return ShareSize(
            stream_bytes=total,
            player_bytes=player,
            single_file_bytes=player + (total + 2) // 3 * 4,
            single_file_possible=total <= MAX_SINGLE_FILE_BYTES,
            frames=stream.manifest.frame_count,
            seconds=stream.manifest.duration,
        )
