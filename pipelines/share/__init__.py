"""Sharing: the browser player with a stream, as a folder for any web server, as one HTML file, or served from here."""

from pipelines.share.folder import share_folder
from pipelines.share.results import PageText, Shared, ShareSize
from pipelines.share.single_file import MAX_SINGLE_FILE_BYTES, share_single_file
from pipelines.share.size import share_size

__all__ = [
    "MAX_SINGLE_FILE_BYTES",
    "PageText",
    "ShareSize",
    "Shared",
    "share_folder",
    "share_single_file",
    "share_size",
]
