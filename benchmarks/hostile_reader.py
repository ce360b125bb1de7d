"""Reads mutated streams with the library: each is refused with a sentence, or its frames and its sound are decoded.

    python benchmarks/hostile_reader.py STREAM [--count 20000] [--first 0]

The mutations are those of `hostile_streams.py`, which plays them in a browser, and others of the sound file if the
stream has one: sizes and checksums fit, as a malicious writer would make them. Prints what happened, the slowest
mutation and the largest memory of the process; exit code 1 if anything but a StudioError was raised, or if a frame has
a number that is not finite. Mutation N is always the same.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import random
import resource
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

from hostile_streams import MANIFEST, Files, _changed_bytes, mutate, read_stream, signed

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream import StreamReader

SOUND_SHARE = 8
"""Every eighth mutation is one of the sound file."""


class Memory:
    """A stream in memory, as a `studio.stream.source.Source`."""

    name = "mutated"

    def __init__(self, files: Files) -> None:
        self._files = files

    def read(self, path: str, limit: int) -> bytes:
        """See `Source.read`."""
        data = self._files.get(path)
        if data is None or len(data) > limit:
            raise StudioError("stream.file_missing", "no such file, or too long", file=path)
        return data


def mutated_sound(files: Files, number: int) -> Files:
    """The stream with a changed sound file."""
    rng = random.Random(number)
    values = json.loads(files[MANIFEST])
    entry = values["audio"]
    data = _changed_bytes(rng, files[entry["path"]])
    digest = hashlib.sha256(data).hexdigest()
    entry["bytes"], entry["sha256"], entry["path"] = len(data), digest, f"files/{digest[:32]}.m4a"
    changed = {**files, entry["path"]: data}
    return {**changed, MANIFEST: signed(values, changed)}


def check_drawable(splats: Gaussians) -> None:
    """Raises ValueError unless all that a renderer derives from the splats is finite."""
    scales = splats.log_scales.exp()
    for name, values in (*splats.items(), ("scales", scales), ("covariances", scales.square())):
        if not bool(values.isfinite().all()):
            raise ValueError(f"{name} are not finite")


def read_all(files: Files) -> str:
    """Decode the first frame of each group, its last one, and the sound; "read" or "refused CODE"."""
    outcome = "read"
    try:
        with StreamReader.open(Memory(files), threads=1) as reader:
            for group in reader.manifest.groups[:20]:
                for frame in (group.first_frame, group.first_frame + min(group.frame_count, 50) - 1):
                    check_drawable(reader.gaussians(frame))
            with contextlib.ExitStack() as stack:
                sound = reader.sound()
                if sound is not None:
                    stack.callback(sound.close)
                    sound.read(0, 4800)
    except StudioError as error:
        outcome = f"refused {error.code}"
    return outcome


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", type=Path)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    files = read_stream(options.stream)
    sounds = json.loads(files[MANIFEST]).get("audio") is not None
    outcomes: Counter[str] = Counter()
    slowest, failed = (0.0, -1), 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(options.first, options.first + options.count):
        sound = sounds and number % SOUND_SHARE == 0
        changed = mutated_sound(files, number) if sound else mutate(files, number)[1]
        began = time.perf_counter()
        try:
            outcomes[read_all(changed)] += 1
        except Exception:
            failed += 1
            print(f"mutation {number}:")
            traceback.print_exc(limit=-3, file=sys.stdout)
        slowest = max(slowest, (time.perf_counter() - began, number))
    for outcome, count in outcomes.most_common():
        print(f"{count:7d}  {outcome}")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"slowest: {slowest[0]:.2f} s (mutation {slowest[1]}); memory {before // 1024} -> {memory // 1024} MB")
    print(f"{options.count} mutations, {failed} without a sentence")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
