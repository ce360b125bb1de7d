import json
from pathlib import Path

import pytest

from tests.studio.stream.conftest import clouds
from tests.support.sounds import click_times, clicks, write_wav
from tests.support.streams import contents
from tests.support.tiny_capture import Here
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, write_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream import StreamReader, check_stream


def manifest_of(take):
    return json.loads((take / "stream" / "manifest.json").read_bytes())


def test_a_take_is_baked_as_a_ladder(here: Here, copied: Path) -> None:
    take = copied / "take"
    rungs = "[{qp: 20}, {qp: 34}, {qp: 30, splats: 0.5, sh_degree: 0, finetune_iterations: 10}]"
    here("bake", take, "--bake.ladder", rungs).ok()
    manifest = manifest_of(take)
    assert [rendition["id"] for rendition in manifest["renditions"]] == ["qp20", "qp34", "qp30-splats50-sh0"]
    best, coarse, phone = manifest["renditions"]
    assert best["psnr_to_trained"] > coarse["psnr_to_trained"] > 10
    assert phone["psnr_to_trained"] > 10
    assert phone["splats"] < best["splats"]
    assert [rendition["pruning"] for rendition in manifest["renditions"]] == ["none", "none", "fine-tuned"]
    assert all(name == "manifest.json" or name.startswith("files/") for name in contents(take / "stream"))
    with StreamReader.open(take / "stream") as reader:
        assert not check_stream(reader).damage
        assert len(list(reader.iterate())) == 5

    ladder = inodes(take)
    tuned = {path: path.stat().st_mtime_ns for path in take.glob("train/*/offsets_*")}
    assert sorted(path.name for path in tuned) == ["offsets_splats50-sh0-10.safetensors"] * 2
    assert "up to date" in here("bake", take).ok().stdout.lower()
    here("bake", take, "--bake.ladder", rungs.replace("34", "36").replace("30", "32")).ok()
    assert {path: path.stat().st_mtime_ns for path in tuned} == tuned
    kept = {f"files/{name}" for name, _ in inodes(take).items() & ladder.items()}
    best = [group["renditions"][0] for group in manifest_of(take)["groups"]]
    assert {rendition[kind]["path"] for rendition in best for kind in ("side", "video")} <= kept
    assert len(inodes(take)) <= 12

    here("evaluate", take).ok()
    figures = json.loads((take / "evaluation.json").read_bytes())
    with StreamReader.open(take / "stream") as reader:
        assert figures["summary"]["bytes_per_frame"] == round(reader.played_bytes / 5, 1)


def heard(take):
    with StreamReader.open(take / "stream") as reader:
        assert not check_stream(reader).damage
        sound = reader.sound()
        assert sound.samples == 5 * 48_000 // 25
        times = click_times(sound.read(0, sound.samples))
        sound.close()
    return times


def inodes(take):
    names = {path.name: path.stat().st_ino for path in (take / "stream" / "files").iterdir()}
    return {name: inode for name, inode in names.items() if not name.endswith(".m4a")}


def test_only_the_sound_is_baked_again(here: Here, copied: Path) -> None:
    take, wav = copied / "take", copied / "take.wav"
    write_wav(wav, clicks(0.3, [0.08]))
    here("bake", take, "--capture.audio", wav).ok()
    assert heard(take) == pytest.approx([0.08], abs=0.0005)
    frames = inodes(take)
    result = here("bake", take, "--capture.audio_offset", "0.04", "--json").ok()
    assert heard(take) == pytest.approx([0.12], abs=0.0005)
    assert inodes(take) == frames
    assert "bake.short_sound" not in result.stdout, "0.04 s of silence are not worth a warning"
    stages = here("status", take, "--json").ok().result["stages"]
    assert {stages[name]["state"] for name in ("calibrate", "initialize", "train", "bake")} == {"done"}

    assert "up to date" in here("bake", take).ok().stdout.lower()
    write_wav(wav, clicks(0.1, [0.05]))
    result = here("bake", take, "--capture.audio_offset", "0", "--json").ok()
    assert heard(take) == pytest.approx([0.05], abs=0.0005)
    assert "bake.short_sound" in result.stdout
    here("bake", take, "--capture.audio", "null").ok()
    with StreamReader.open(take / "stream") as reader:
        assert reader.manifest.audio is None
    assert inodes(take) == frames
    assert not list((take / "stream" / "files").glob("*.m4a"))


def test_the_set_is_baked_when_it_changes(here: Here, copied: Path) -> None:
    """Groups keep their files. Edits of the world move it, too. Training without plates does not depend on it."""
    take = Take.open(copied / "take")
    here("run", take.root, "--until", "bake", "--train.use_plates", "false").ok()
    splats = clouds(1, 80)[0]
    kinds = ("side", "video")
    paths = [group["renditions"][0][kind]["path"] for group in manifest_of(take.root)["groups"] for kind in kinds]
    frames = {path: (take.stream / path).stat().st_ino for path in paths}
    for size in (80, 50):
        write_frame(take.set_splats, splats[:size], FrameMetadata())
        here("bake", take.root).ok()
        with StreamReader.open(take.stream) as reader:
            assert not check_stream(reader).damage
            assert len(reader.set_splats() or ()) == size
        assert "up to date" in here("bake", take.root).ok().stdout.lower()
    assert {path: (take.stream / path).stat().st_ino for path in paths} == frames
    here("edit", "world", take.root, "--scale", "2").ok()
    here("bake", take.root).ok()
    with StreamReader.open(take.stream) as reader:
        moved = reader.set_splats()
        assert moved is not None
        assert moved.means.std() > 1.5 * splats[:50].means.std()
    take.set_splats.unlink()
    here("bake", take.root).ok()
    with StreamReader.open(take.stream) as reader:
        assert reader.set_splats() is None
