"""Streams as a malicious writer would make them, for the library and for the browser; folders with Python files of a
stranger, of which none may be executed.

Each mutation changes the manifest, a side file (compressed, or its content), a video or the sound of a stream
without pages, and then updates all sizes and checksums. Mutation N is always the same.
"""

import contextlib
import hashlib
import json
import random
import zlib
from pathlib import Path
from typing import Any

from tests.support.splats import assert_drawable
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import Source, StreamReader

Files = dict[str, bytes]
"""A stream's files by their path in it."""

MANIFEST = "manifest.json"

VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 7, 255, 65536, 2**31, 2**53, 1e300, -1e9, 1e-300),
    *("", "x", "../x", [], {}, [[]]),
]


def signed(values: Any, files: Files) -> bytes:
    """The bytes of a manifest, with the total size and the checksum filled in; as good as possible for nonsense."""
    try:
        entries = [one[key] for group in values["groups"] for one in group["renditions"] for key in ("side", "video")]
        entries += [values["audio"]] if values.get("audio") else []
        groups = sum({entry["path"]: entry["bytes"] for entry in entries}.values())  # each file once
        values["manifest_sha256"] = zeros = "0" * 64
        for _ in range(5):
            data = json.dumps(values).encode()
            values["total_bytes"] = groups + len(data)
        return data.replace(zeros.encode(), hashlib.sha256(data).hexdigest().encode(), 1)
    except (TypeError, KeyError, ValueError, IndexError, AttributeError):
        return json.dumps(values).encode()


def with_file(files: Files, group: int, key: str, data: bytes, raw_bytes: int | None = None) -> Files:
    """The stream with another file in the best rendition of a group: `key` is "side" or "video"."""
    values = json.loads(files[MANIFEST])
    best = values["groups"][group]["renditions"][0]
    best["bytes"] += len(data) - best[key]["bytes"]
    if raw_bytes is not None:
        best[key]["raw_bytes"] = raw_bytes
    return _with(files, values, best[key], data)


def _with(files: Files, values: Any, entry: dict[str, Any], data: bytes) -> Files:
    """The stream with the manifest `values`, and other content for the file of one of its entries."""
    digest, suffix = hashlib.sha256(data).hexdigest(), entry["path"].rpartition(".")[2]
    entry.update(bytes=len(data), sha256=digest, path=f"files/{digest[:32]}.{suffix}")
    changed = {**files, entry["path"]: data}
    return {**changed, MANIFEST: signed(values, changed)}


def _changed_bytes(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(changed))
        kind = rng.randrange(4)
        if kind == 0:
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at : at + rng.randint(1, 16)] = rng.randbytes(rng.randint(0, 16))
        elif kind == 2:
            changed[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0"])
        else:
            del changed[at : at + rng.randint(1, 200)]
        if not changed:
            changed = bytearray(b"\0")
    return bytes(changed)


def changed_manifest(rng: random.Random, data: bytes) -> Any:
    """The values of a manifest, or of a page of the index, with another value in one place."""
    values = at = json.loads(data)
    for _ in range(rng.randint(1, 6)):
        key = rng.choice(list(at) if isinstance(at, dict) else list(range(len(at))))
        if isinstance(at[key], dict | list) and at[key] and rng.random() < 0.85:
            at = at[key]
            continue
        at[key] = rng.choice(VALUES)
        return values
    return [values] * 2


def mutate(files: Files, number: int) -> tuple[str, Files]:
    """The part that mutation `number` of a stream changes, and the stream with it."""
    rng = random.Random(number)
    kind = rng.choice(["manifest", "nonsense", "side content", "side file", "video", "video"])
    if kind == "nonsense" and rng.random() < 0.8:
        kind = "manifest"
    if kind == "manifest":
        return kind, {**files, MANIFEST: signed(changed_manifest(rng, files[MANIFEST]), files)}
    if kind == "nonsense":
        deep = rng.choice([b"[", b'{"format":'])
        return kind, {**files, MANIFEST: deep * rng.randint(1, 100_000)}
    groups = json.loads(files[MANIFEST])["groups"]
    group = rng.randrange(len(groups))
    key = "video" if kind == "video" else "side"
    data = files[groups[group]["renditions"][0][key]["path"]]
    if kind != "side content":
        return kind, with_file(files, group, key, _changed_bytes(rng, data))
    raw = _changed_bytes(rng, zlib.decompress(data, wbits=-15))
    packer = zlib.compressobj(wbits=-15)
    return kind, with_file(files, group, key, packer.compress(raw) + packer.flush(), len(raw))


class Memory(Source):
    """A stream in memory."""

    name = "mutated"

    def __init__(self, files: Files) -> None:
        self._files = files

    def read(self, path: str, limit: int) -> bytes:
        data = self._files.get(path)
        if data is None or len(data) > limit:
            raise StudioError("stream.file_missing", "no such file, or too long", file=path)
        return data


def mutate_sound(files: Files, number: int) -> Files:
    """Mutation `number` of the stream's sound file."""
    values = json.loads(files[MANIFEST])
    data = _changed_bytes(random.Random(number), files[values["audio"]["path"]])
    return _with(files, values, values["audio"], data)


def read_all(files: Files) -> str:
    """Decode the first frame of each group, its last one, and the sound; "read" or "rejected CODE"."""
    try:
        with StreamReader.open(Memory(files)) as reader:
            for group in reader.groups[:20]:
                for frame in (group.first_frame, group.first_frame + min(group.frame_count, 50) - 1):
                    assert_drawable(reader.gaussians(frame))
            sound = reader.sound()
            if sound is not None:
                with contextlib.closing(sound):
                    sound.read(0, 4800)
    except StudioError as error:
        return f"rejected {error.code}"
    return "read"


PLANTED = ("argparse.py", "json.py", "numpy.py", "sitecustomize.py")
PLANTED += ("pipelines/__init__.py", "studio/__init__.py", "v3studio/__init__.py")


def plant(folder: Path, told: Path) -> None:
    """Put files into a folder that hide modules of Python, of libraries and of this program, and say if they run."""
    for name in PLANTED:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(f"open({str(told)!r}, 'a').write(__file__ + chr(10))\n")
    (folder / "matplotlibrc").write_text("text.usetex: True\n")  # would start LaTeX


def executed(told: Path) -> str:
    """Names of what was executed; "" if nothing was."""
    return told.read_text() if told.exists() else ""
