"""Downloading matting models, from a package that the test makes."""

import hashlib
import io
import json
import socket
import tarfile
from dataclasses import replace
from pathlib import Path
from threading import Thread

import pytest

from tests.support.errors import refuses
from v3studio.studio.masks.models import MODELS, Model, get_model, model_named

WEIGHTS = bytes(range(256)) * 40


def package_of(name: str, folder: Path) -> Path:
    """A package with `WEIGHTS`, laid out as that of the model."""
    index = {"/models/medium": {"chunks": [{"hash": "aa"}, {"hash": "bb"}]}}
    files = {"dist/bb": WEIGHTS[5000:], "dist/resources.json": json.dumps(index).encode(), "dist/aa": WEIGHTS[:5000]}
    path = folder / "package"
    with tarfile.open(path, "w:gz") as archive:
        for file, data in ({"selfie_segmentation.tflite": WEIGHTS} if name == "selfie" else files).items():
            header = tarfile.TarInfo(f"package/{file}")
            header.size = len(data)
            archive.addfile(header, io.BytesIO(data))
    return path


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_weights_are_unpacked_and_checked(model: Model, tmp_path: Path) -> None:
    package, folder = package_of(model.name, tmp_path), tmp_path / "models"
    with refuses("mask.model_damaged"):
        get_model(model, folder, package)
    assert not list(folder.glob("*"))
    checked = replace(model, sha256=hashlib.sha256(WEIGHTS).hexdigest())
    file = get_model(checked, folder, package)
    assert file.name == {"selfie": "selfie.tflite"}.get(model.name, f"{model.name}.onnx")
    assert file.read_bytes() == WEIGHTS
    package.unlink()
    assert get_model(checked, folder, package) == file  # not needed again
    package.write_bytes(b"something else")
    with refuses("mask.model_damaged"):
        get_model(model, tmp_path / "others", package)
    assert not list((tmp_path / "others").glob("*"))


def test_what_cannot_be_downloaded_is_reported(tmp_path: Path) -> None:
    with refuses("mask.model_download"):
        get_model(replace(MODELS[0], url="http://127.0.0.1:9/package"), tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def half() -> None:
            with server.accept()[0] as client:
                client.recv(4096)
                client.sendall(b"HTTP/1.0 200 OK\r\nContent-Length: 8\r\n\r\nhalf")

        Thread(target=half, daemon=True).start()
        with refuses("mask.model_download"):
            get_model(replace(MODELS[0], url=f"http://127.0.0.1:{server.getsockname()[1]}/"), tmp_path)


def test_models_are_found_by_name() -> None:
    assert [model_named(model.name) for model in MODELS] == list(MODELS)
    with refuses("mask.model_unknown", value="resnet"):
        model_named("resnet")
