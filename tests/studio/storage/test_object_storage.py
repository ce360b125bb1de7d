"""Footage in a real S3 store: what is fetched, how often, and what goes wrong."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import s3fs

from tests.support.object_store import SECRET, Faults, ObjectStore
from tests.support.tiny_capture import write_capture
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import open_footage
from v3studio.studio.storage import cached_object, mirrored, objects, store, whole_files
from v3studio.studio.storage.store import without_secrets

DAY = "s3://studio/day1"


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "BLOCK", 4096)
    monkeypatch.setattr(store, "FIRST_PAUSE", 0.01)


def put(object_store: ObjectStore, key: str, data: bytes) -> None:
    object_store.client.put_object(Bucket="studio", Key=f"day1/{key}", Body=data)


@pytest.mark.parametrize("options", [{}, {"movflags": "+faststart"}], ids=["index_at_end", "index_at_start"])
def test_only_the_needed_gops_of_a_video_are_fetched(
    object_store: ObjectStore, tmp_path: Path, small_blocks: None, make: SimpleNamespace, options: dict[str, str]
) -> None:
    noise = np.random.default_rng(3).integers(0, 255, (240, 64, 96, 3), dtype=np.uint8)  # frames of kilobytes
    local = tmp_path / "day1" / "videos" / "cam0.mp4"
    make.video(local, noise, options={"g": "8", "bf": "2"}, container_options=options)  # GOPs of 8 frames
    object_store.upload(tmp_path / "day1", "day1")
    video = mirrored(DAY) / "videos" / "cam0.mp4"
    here, there = VideoReader(local), VideoReader(video)
    assert (there.frame_count, there.fps, there.width, there.height) == (240, 25.0, 96, 64)
    for frame in (150, 151, 152, 149, 153):
        np.testing.assert_array_equal(there.read(frame), here.read(frame))
    ranges = [key[1].removeprefix("bytes=").split("-") for key in object_store.gets.elements()]
    fetched = sum(int(last) - int(first) + 1 for first, last in ranges)
    assert fetched < local.stat().st_size / 2, "not the whole video"
    assert object_store.fetched_twice("day1") == []
    # the times of all frames are known from the header alone
    for frame in (0, 239, 33):
        np.testing.assert_array_equal(there.read(frame), here.read(frame))
    assert object_store.fetched_twice("day1") == []


def test_requests_that_fail_or_end_early_are_repeated(object_store: ObjectStore, small_blocks: None) -> None:
    data = np.random.default_rng(5).bytes(200_000)
    put(object_store, "cam0.mp4", data)
    object_store.faults = Faults(failing=0.1, truncated=0.1, delay=0.002)
    video = mirrored(DAY) / "cam0.mp4"

    def read(seed: int) -> None:
        stored = cached_object(video)  # one for each thread, as for processes
        places = np.random.default_rng(seed).integers(0, len(data), 40)
        for start in map(int, places):
            assert stored.read_at(start, 3000) == data[start : start + 3000]

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(read, range(4)))
    assert object_store.failed > 3
    assert object_store.fetched_twice("day1") == []


def test_the_cache_keeps_the_last(object_store: ObjectStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(4):
        put(object_store, f"cam{number}.mp4", bytes([number + 1]) * 40_000)
    monkeypatch.setenv("V3STUDIO_CACHE_GIGABYTES", "100_000e-9")
    root = mirrored(DAY)

    def read(number: int) -> bytes:
        return cached_object(root / f"cam{number}.mp4").read()

    def kept() -> list[Path]:
        return [path for path in (tmp_path / "cache" / "objects").rglob("*") if path.is_file()]

    for number in range(4):
        before = set(kept())
        assert read(number) == bytes([number + 1]) * 40_000
        for path in set(kept()) - before:
            os.utime(path, (number, number))
    assert sum(path.stat().st_blocks * 512 for path in kept()) <= 100_000
    object_store.gets.clear()
    assert [read(number)[0] for number in (2, 3)] == [3, 4]
    assert not object_store.gets, "the oldest went first"
    assert read(0) == bytes([1]) * 40_000
    assert object_store.gets, "fetched again"


def test_a_changed_object_is_fetched_again_and_a_deleted_one_is_gone(object_store: ObjectStore, tmp_path: Path) -> None:
    write_capture(tmp_path / "day1", frames=2)
    object_store.upload(tmp_path / "day1", "day1")
    spec = CaptureSettings(root=DAY, images="images/{camera}/{frame:03d}.png")
    first = open_footage(spec)
    before, digest = first.raw_image("cam0", 0), first.digest()
    assert open_footage(spec).digest() == digest
    image = (tmp_path / "day1" / "images" / "cam1" / "000.png").read_bytes()
    put(object_store, "images/cam0/000.png", image)
    object_store.client.delete_object(Bucket="studio", Key="day1/images/cam0/001.png")
    again = open_footage(spec, strict=False)
    assert not np.array_equal(again.raw_image("cam0", 0), before)
    np.testing.assert_array_equal(again.raw_image("cam0", 0), again.raw_image("cam1", 0))
    assert again.digest() != digest
    assert again.frames_of("cam0") == (0,)


def test_errors_tell_no_secrets(object_store: ObjectStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(address: str) -> StudioError:
        s3fs.S3FileSystem.clear_instance_cache()
        with pytest.raises(StudioError) as caught:
            mirrored(address)
        assert SECRET not in str(caught.value)
        return caught.value

    monkeypatch.setattr(store, "FIRST_PAUSE", 0.01)
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    codes = {"s3://no-such-bucket/day1": "not_found", DAY: "empty", "ftp://studio/day1": "unknown_kind"}
    for address, code in {**codes, "s3:///day1": "no_bucket_named"}.items():
        assert refused(address).code == f"storage.{code}"
    addresses = ("s3://AKIA:hidden@studio/day1", "s3://AKIA:abc/hidden@studio/day1", "s3:///AKIA:hidden@studio")
    for hidden in (*addresses, "az://studio/day1?sig=hidden"):
        named = refused(hidden)
        assert named.code == "storage.credentials_in_address"
        assert "hidden" not in str(named.message.to_dict())
        with pytest.raises(StudioError, match="contains credentials") as caught_setting:
            CaptureSettings(root=hidden)
        assert "hidden" not in str(caught_setting.value)
    object_store.faults = Faults(failing=1.0)
    assert refused(DAY).code == "storage.failed"
    object_store.faults = Faults()
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAWRONG")
    denied = refused(DAY)
    assert denied.code == "storage.denied"
    assert "that they may list this bucket." in str(denied), "reading needs no permission to write"
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    assert refused(DAY).code == "storage.no_credentials"


def test_messages_hide_secret_values_and_signatures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "q83hX==")
    text = without_secrets("https://a.blob.core.windows.net/x?sv=1&sig=ab%2Bc&se=2 with q83hX==")
    assert text == "https://a.blob.core.windows.net/x?sv=1&sig=***&se=2 with ***"


def test_whole_files_are_copies_that_listing_again_does_not_take_away(object_store: ObjectStore) -> None:
    for name in ("model.onnx", "model.onnx_data"):
        put(object_store, name, name.encode() * 1000)
    path = mirrored(DAY) / "model.onnx"
    digest = digest_files(path.parent, [path])
    given = [path, path.with_name("model.onnx_data"), path.with_name("model.onnx.data")]
    model, weights, missing = whole_files(given)
    mirrored(DAY)  # as another process does
    assert model.read_bytes() == b"model.onnx" * 1000
    assert weights.read_bytes() == b"model.onnx_data" * 1000
    assert (weights.parent, weights.name) == (model.parent, "model.onnx_data")
    assert missing == given[2]
    assert digest_files(path.parent, [path]) == digest, "the same before and after"
    put(object_store, "model.onnx", b"another")
    assert whole_files([mirrored(DAY) / "model.onnx"])[0].read_bytes() == b"another"
    assert model.read_bytes() == b"model.onnx" * 1000, "a run that has begun keeps its model"


def test_objects_that_no_file_can_be_named_after(object_store: ObjectStore) -> None:
    put(object_store, "a", b"")
    put(object_store, "a/b.mp4", b"video")
    assert cached_object(mirrored(DAY) / "a" / "b.mp4") is not None, "an empty object marks a folder"
    put(object_store, "a", b"text")
    with pytest.raises(StudioError, match=r"^s3://studio/day1/a: the object has the name of a folder"):
        mirrored(DAY)
    object_store.client.delete_object(Bucket="studio", Key="day1/a/b.mp4")
    assert cached_object(mirrored(DAY) / "a") is not None, "what was a folder is an object now"
    long = "x" * 300
    put(object_store, f"{long}.mp4", b"video")
    with pytest.raises(StudioError, match=rf"^s3://studio/day1/{long}.mp4: the object's name is too long"):
        mirrored(DAY)
