import ssl
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

import pytest

from v3studio.pipelines.share.serving import serve
from v3studio.studio.stream.manifest import MANIFEST_NAME


def test_several_streams_with_a_secret_over_https(tmp_path: Path) -> None:
    for name in ("b", "a é"):
        (tmp_path / name).mkdir()
        (tmp_path / name / MANIFEST_NAME).write_text(f'"{name}"', encoding="utf-8")
    trust = ssl._create_unverified_context()
    with serve(tmp_path, https=True, token=True) as serving:
        assert [folder.name for folder in serving.streams.values()] == ["a é", "b"]
        assert serving.address == next(iter(serving.streams))
        for address, folder in serving.streams.items():
            with urlopen(f"{address}{MANIFEST_NAME}", context=trust) as answer:
                assert answer.read().decode() == f'"{folder.name}"'
            with urlopen(Request(address, headers={"Accept": "text/html"}), context=trust) as answer:
                assert b"<v3-player" in answer.read()
        host, _, secret = serving.bases[0].rpartition("/")
        assert len(secret) > 20
        with pytest.raises(HTTPError) as refused:
            urlopen(f"{host}/b/{MANIFEST_NAME}", context=trust)
        assert refused.value.code == 404
        assert len(serving.fingerprint) == 32 * 3 - 1
    serving.close()
    with pytest.raises(URLError):
        urlopen(serving.address, context=trust)
