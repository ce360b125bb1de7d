"""Publishing: what is missing, the manifest last."""

from pathlib import Path

import pytest

from tests.studio.stream.conftest import MakeLadder
from tests.support.errors import refuses
from tests.support.object_store import ObjectStore
from tests.support.streams import contents
from v3studio.studio.errors import Cancelled
from v3studio.studio.stream import Rung, StreamReader, check_stream
from v3studio.studio.stream.publish import publish


def test_what_is_there_is_not_copied_again(make_ladder: MakeLadder, tmp_path: Path) -> None:
    """The sound is copied, too."""
    folder, target = make_ladder((2, 2), splats=60, clicks=[0.05]), tmp_path / "web" / "stream"
    with StreamReader.open(folder) as reader:
        first = publish(reader, str(target))
        again = publish(reader, str(target))
    assert contents(target) == contents(folder)
    assert first.copied == len(contents(folder)) - 1
    assert first.present == 0
    assert (again.copied, again.bytes, again.present) == (0, 0, first.copied)
    make_ladder((2, 2), splats=60, ladder=(Rung(qp=24), Rung(qp=38)))
    with StreamReader.open(folder) as reader:
        more = publish(reader, str(target))
    assert 0 < more.copied < first.copied
    with StreamReader.open(target) as reader:
        assert not check_stream(reader).damage
        assert [rendition.id for rendition in reader.manifest.renditions] == ["qp24", "qp38"]


def test_the_manifest_is_last(make_ladder: MakeLadder, tmp_path: Path) -> None:
    folder = make_ladder((2, 2), splats=60)

    def stop(done, total, **figures):
        if done == total - 1:
            raise Cancelled

    with StreamReader.open(folder) as reader, pytest.raises(Cancelled):
        publish(reader, str(tmp_path / "web"), stop)
    assert not (tmp_path / "web" / "manifest.json").exists()


def test_a_damaged_file_is_not_published(make_ladder: MakeLadder, tmp_path: Path) -> None:
    folder = make_ladder((2,), splats=60)
    with StreamReader.open(folder) as reader:
        path = reader.groups[0].files[1].path
        (folder / path).write_bytes(b"x")
        with refuses("stream.wrong_size", file=f"{folder}/{path}"):
            publish(reader, str(tmp_path / "web"))
    assert not (tmp_path / "web" / "manifest.json").exists()


def test_to_a_store(make_ladder: MakeLadder, object_store: ObjectStore) -> None:
    """S3 serves a file with the type and the caching that it was written with."""
    folder, client = make_ladder((2,), splats=60), object_store.client
    with StreamReader.open(folder) as reader:
        first = publish(reader, "s3://studio/take")
        assert publish(reader, "s3://studio/take").copied == 0
    listed = client.list_objects_v2(Bucket="studio", Prefix="take/")["Contents"]
    keys = [entry["Key"] for entry in listed]
    objects = {key.removeprefix("take/"): client.get_object(Bucket="studio", Key=key) for key in keys}
    headers = {name: (answer["ContentType"], answer["CacheControl"]) for name, answer in objects.items()}
    assert headers.pop("manifest.json") == ("application/json", "no-cache")
    assert all("immutable" in cache for _, cache in headers.values())
    assert {kind for name, (kind, _) in headers.items() if name.endswith(".mp4")} == {"video/mp4"}
    assert {name: answer["Body"].read() for name, answer in objects.items()} == contents(folder)
    assert first.copied == len(objects) - 1


def test_what_cannot_be_published(make_ladder: MakeLadder, object_store: ObjectStore, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with StreamReader.open(make_ladder((1,), splats=40, name="three")) as reader:
        for target, code in {
            str(tmp_path / "file" / "x"): "publish.failed",
            "nosuchstore://bucket/take": "storage.unknown_kind",
            "s3://no-such-bucket/take": "storage.not_found",
        }.items():
            with refuses(code, file=target):
                publish(reader, target)


def test_only_s3_is_given_headers(make_ladder: MakeLadder, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other stores refuse such options."""
    given = {}

    class Files:
        def find(self, root, **options):
            return {}

        def pipe_file(self, path, data, **headers):
            given[path] = headers

    monkeypatch.setattr("fsspec.core.url_to_fs", lambda url, **options: (Files(), "bucket/take/"))
    with StreamReader.open(make_ladder((2,), splats=60)) as reader:
        publish(reader, "gs://bucket/take/")
    assert "bucket/take/manifest.json" in given
    assert not any(given.values())
