"""The header of OpenEXR files: its windows and channels, in a form that FFmpeg reads.

Source: "OpenEXR File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html. FFmpeg ignores where the display
window begins, reads R, G and B of one layer that must be named, and reads a single channel only if it is called Y.
"""

import struct
from collections.abc import Iterator

_LINES = {3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}  # per chunk, by the number of the compression; else 1
_NOT_SCANLINES = 0x200 | 0x800 | 0x1000  # flags: tiles, deep data, several parts


def exr_for_ffmpeg(data: bytes) -> tuple[bytes, str | None]:
    """The file with a display window that begins at 0 and, if it has a single channel, one that is called Y; and the
    layer with the image: "" is the default one, None means that none can be told to be it.

    Raises ValueError, IndexError and struct.error: the header is damaged.
    """
    patched, flags = bytearray(data), struct.unpack_from("<I", data, 4)[0]
    parts = dict(_attributes(data))
    names = {name.decode("latin-1"): at for name, at in _channel_names(data, parts[b"channels"])}
    if len(names) == 1:
        name, at = names.popitem()
        layer = name.rpartition(".")[0] or ("" if len(name) == 1 else None)
        patched[at + len(name) - 1] = ord("Y")
    else:
        colors = {name[:-1].rstrip(".") for name in names if name[-1:] == "R"}
        layers = [layer for layer in colors if {f"{layer}.{end}".lstrip(".") for end in "RGB"} <= names.keys()]
        layer = "" if "" in layers or "Y" in names else layers[0] if len(layers) == 1 else None
    left, top = struct.unpack_from("<2i", data, parts[b"displayWindow"])
    if (left, top) != (0, 0) and not flags & _NOT_SCANLINES & ~0x200:
        first, last = (struct.unpack_from("<i", data, parts[b"dataWindow"] + at)[0] for at in (4, 12))
        for window in (b"displayWindow", b"dataWindow"):
            _shift(patched, parts[window], (left, top, left, top))
        if not flags & 0x200:  # chunks of lines begin with the number of the first one
            table = parts[b""]
            for index in range(-(-(last - first + 1) // _LINES.get(data[parts[b"compression"]], 1))):
                _shift(patched, struct.unpack_from("<Q", data, table + 8 * index)[0], (top,))
    return bytes(patched), layer


def _shift(data: bytearray, at: int, by: tuple[int, ...]) -> None:
    form = f"<{len(by)}i"
    values = struct.unpack_from(form, data, at)
    struct.pack_into(form, data, at, *(value - part for value, part in zip(values, by, strict=True)))


def _attributes(data: bytes) -> Iterator[tuple[bytes, int]]:
    """Name and place of the value of each attribute; at last an empty name and the place after the header."""
    at = 8
    while data[at]:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        yield data[at:name_end], kind_end + 5
        at = kind_end + 5 + struct.unpack_from("<i", data, kind_end + 1)[0]
        if at <= kind_end:
            raise ValueError("a size is negative")
    yield b"", at + 1


def _channel_names(data: bytes, at: int) -> Iterator[tuple[bytes, int]]:
    """Name and place of each channel in the list that begins at `at`."""
    while data[at]:
        end = data.index(0, at)
        yield data[at:end], at
        at = end + 17
