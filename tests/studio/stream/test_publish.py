"""Publishing: what is missing, the manifest last."""

import fsspec
import pytest

from studio.errors import Cancelled
from studio.stream import Rung, StreamReader
from studio.stream.publish import publish
from tests.support.errors import refuses


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_is_there_is_not_copied_again(make_ladder, tmp_path):
    folder, target = make_ladder((2, 2), splats=60), tmp_path / "web" / "stream"
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
        reader.verify()
        assert [one.id for one in reader.renditions] == ["qp24", "qp38"]


def test_the_manifest_is_last(make_ladder, tmp_path):
    folder = make_ladder((2, 2), splats=60)

    def stop(done, total, **figures):
        if done == total - 1:
            raise Cancelled

    with StreamReader.open(folder) as reader, pytest.raises(Cancelled):
        publish(reader, str(tmp_path / "web"), stop)
    assert not (tmp_path / "web" / "manifest.json").exists()


def test_a_damaged_file_is_not_published(make_ladder, tmp_path):
    folder = make_ladder((2,), splats=60)
    with StreamReader.open(folder) as reader:
        path = reader.groups[0].files[1].path
        (folder / path).write_bytes(b"x")
        with refuses("stream.wrong_size", file=f"{folder}/{path}"):
            publish(reader, str(tmp_path / "web"))
    assert not (tmp_path / "web" / "manifest.json").exists()


def test_to_a_store(make_ladder):
    folder = make_ladder((2,), splats=60)
    with StreamReader.open(folder) as reader:
        first = publish(reader, "memory://publish-test/take")
        assert publish(reader, "memory://publish-test/take").copied == 0
    store = fsspec.filesystem("memory")
    found = {name.split("/take/")[1]: store.cat(name) for name in store.find("/publish-test/take")}
    assert found == contents(folder)
    assert first.copied == len(found) - 1


def test_what_cannot_be_published(make_ladder, tmp_path):
    (tmp_path / "file").write_text("no folder")
    with StreamReader.open(make_ladder((1,), splats=40, name="three")) as reader:
        with refuses("publish.failed", file=str(tmp_path / "file" / "x")):
            publish(reader, str(tmp_path / "file" / "x"))
        with refuses("publish.failed"):
            publish(reader, "nosuchstore://bucket/take")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (type("NoCredentialsError", (Exception,), {})("Unable to locate credentials"), "publish.no_credentials"),
        (FileNotFoundError("The specified bucket does not exist"), "publish.no_bucket"),
        (PermissionError("Access Denied"), "publish.denied"),
        (OSError("reset"), "publish.failed"),
    ],
)
def test_what_a_store_refuses(make_ladder, monkeypatch, error, code):
    def fails(*arguments, **options):
        raise error

    monkeypatch.setattr(fsspec.filesystem("memory"), "pipe_file", fails)
    target = "memory://publish-test/refused"
    with StreamReader.open(make_ladder((1,), splats=40)) as reader, refuses(code, file=target):
        publish(reader, target)


@pytest.mark.parametrize("protocols", ["memory", ("s3", "s3a"), "s3"])
def test_only_stores_that_keep_headers_are_given_them(make_ladder, monkeypatch, protocols):
    """S3 serves a file with the type and the caching that it was written with; other stores refuse such options."""
    given = {}

    class Files:
        protocol = protocols

        def find(self, root, detail):
            raise FileNotFoundError(root)

        def makedirs(self, path, exist_ok):
            pass

        def pipe_file(self, path, data, **headers):
            given[path] = headers

    monkeypatch.setattr("fsspec.core.url_to_fs", lambda url: (Files(), "bucket/take/"))
    with StreamReader.open(make_ladder((2,), splats=60)) as reader:
        publish(reader, "store://bucket/take/")
    assert "bucket/take/manifest.json" in given
    if protocols == "memory":
        assert set(map(str, given.values())) == {"{}"}
        return
    manifest = given.pop("bucket/take/manifest.json")
    assert manifest["ContentType"] == "application/json"
    assert "no-cache" in manifest["CacheControl"]
    assert all("immutable" in headers["CacheControl"] for headers in given.values())
    videos = [headers for path, headers in given.items() if path.endswith(".mp4")]
    assert videos
    assert all(headers["ContentType"] == "video/mp4" for headers in videos)
