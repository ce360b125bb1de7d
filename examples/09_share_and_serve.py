"""Share a stream as a web page, serve it, and publish it.

    python examples/09_share_and_serve.py demo-take --out site

Without an argument, it bakes a small stream first.
"""

import argparse
import json
import tempfile
from pathlib import Path
from urllib.request import Request, urlopen

from _shapes import swinging_cloud

import v3studio as v3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", nargs="?", type=Path, help="folder of a stream or a take")
    parser.add_argument("--out", type=Path, help="folder for the results (default: a temporary folder)")
    arguments = parser.parse_args()
    out = arguments.out or Path(tempfile.mkdtemp())
    stream = arguments.stream or make_stream(out / "stream")

    text = v3.PageText(title="Swinging cloud", license="CC BY 4.0")
    shared = v3.share(stream, out / "site", text)
    print(f"{shared.path}: {shared.files} files, {shared.total_bytes:,} bytes, for any web server")
    assert "Swinging cloud" in (shared.path / "index.html").read_text(encoding="utf-8")

    # "with" closes the server at the end; port 0 is any free port
    with v3.serve(shared.path / "stream", port=0) as serving:
        print(f"serving {serving.address}")
        with urlopen(Request(serving.address, headers={"Accept": "text/html"})) as page:
            assert b"<v3-player" in page.read()
        with urlopen(f"{serving.address}manifest.json") as manifest:
            frames = json.load(manifest)["frame_count"]
        with v3.StreamReader.open(serving.address) as reader:
            assert reader.manifest.frame_count == frames

    first = v3.publish(stream, out / "published", text, page=True)
    again = v3.publish(stream, out / "published", text, page=True)
    print(f"{out / 'published'}: {first.copied} files copied, then {again.copied}")
    assert (out / "published" / "index.html").is_file()
    assert again.copied == 0


def make_stream(folder: Path) -> Path:
    frames = [swinging_cloud(500, time / 4) for time in range(4)]
    video = v3.SplatVideo("cloud", fps=25, frame_count=len(frames), group_starts=(0,), read=frames.__getitem__)
    v3.bake_video(video, folder, v3.BakeSettings())
    return folder


if __name__ == "__main__":
    main()
