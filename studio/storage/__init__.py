"""Footage and published streams in object storage (S3, Google Cloud Storage, Azure), through fsspec.

Nothing here imports fsspec until an address such as s3://bucket/folder is opened.
"""

from v3studio.studio.storage.address import StoreAddress, is_address
from v3studio.studio.storage.mirror import mirrored
from v3studio.studio.storage.objects import CachedObject, cached_object, whole_files
from v3studio.studio.storage.store import Store

__all__ = ["CachedObject", "Store", "StoreAddress", "cached_object", "is_address", "mirrored", "whole_files"]
