"""Checks that this Python has everything that V3 Studio needs; the last step of `make setup`.

Imports every dependency that pyproject.toml declares, decimates a mesh, encodes and decodes a video frame, opens
Vulkan, and compares the CPU kernels with the reference. Exits with 1 and one sentence for each check that fails.
"""

import faulthandler
import functools
import importlib
import io
import re
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODULES = {"opencv-contrib-python-headless": "cv2", "pillow": "PIL"}
"""Modules of the distributions whose module has another name."""


def modules() -> list[str]:
    """The module of each dependency in pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [re.split(r"[^A-Za-z0-9._-]", text)[0].lower() for text in project["dependencies"]]
    return [MODULES.get(name, name.replace("-", "_")) for name in names]


def check_mesh_filter() -> None:
    """Halve the faces of a small sphere. Without the filter's shared libraries, PyMeshLab silently lacks it."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.create_sphere(subdiv=2)
    before = meshes.current_mesh().face_number()
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=before // 2)
    after = meshes.current_mesh().face_number()
    if not 0 < after <= before // 2:
        raise RuntimeError(f"{before} faces were reduced to {after}, expected at most {before // 2}")


def check_video() -> None:
    """Encode a gradient with libx264, decode it, and compare luma."""
    import av
    import numpy as np

    image = np.full((96, 64), 128, np.uint8)  # 4:2:0: 64 rows of luma, 32 of chroma
    image[:64] = np.linspace(32, 224, 64)[:, None]
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=30, options={"qp": "20"})
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="yuv420p")))
        out.mux(stream.encode(None))
    with av.open(io.BytesIO(file.getvalue()), "r") as container:
        decoded = next(container.decode(video=0)).to_ndarray()
    error = float(np.abs(decoded[:64].astype(float) - image[:64]).mean())
    if error > 4:
        raise RuntimeError(f"the decoded frame differs from the encoded one by {error:.1f} of 255 levels on average")


def check_vulkan() -> None:
    """Create a Vulkan instance and list its devices, as the window does before it opens."""
    from v3studio.gui.platform.vulkan import vulkan_device

    vulkan_device()


def check_kernels() -> None:
    """Render ten splats with the CPU kernels and with the reference."""
    import numpy as np
    import torch

    from v3studio.studio.cameras import Camera
    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.rasterizer import rasterize

    generator = torch.Generator().manual_seed(0)
    splats = Gaussians(
        means=torch.randn(10, 3, generator=generator) * 0.3,
        quats=torch.randn(10, 4, generator=generator),
        log_scales=torch.randn(10, 3, generator=generator) * 0.3 - 2.0,
        logit_opacities=torch.randn(10, generator=generator),
        sh=torch.randn(10, 4, 3, generator=generator) * 0.3,
    )
    pose = np.eye(4)
    pose[2, 3] = 3.0
    camera = Camera("self-test", 64, 48, np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]]), pose)
    expected = rasterize(splats, camera, backend="reference").image
    difference = (rasterize(splats, camera, backend="cpu").image - expected).abs()
    # Due to rounding, a pixel may be on the other side of the alpha threshold of 1/255.
    if expected.max() < 0.1 or difference.mean() > 1e-4 or difference.max() > 0.02:
        raise RuntimeError(f"the image differs from the reference by up to {float(difference.max()):.3f}")


def main() -> int:
    """Run all checks; returns the exit status."""
    faulthandler.enable()  # names the check that crashes
    begin = time.monotonic()
    checks: dict[str, Callable[[], object]] = {
        f"importing {name}": functools.partial(importlib.import_module, name) for name in modules()
    }
    checks |= {
        "decimating a mesh with pymeshlab": check_mesh_filter,
        "encoding an H.264 frame with av": check_video,
        "opening Vulkan": check_vulkan,
        "rendering with the CPU kernels": check_kernels,
    }
    failures = 0
    for what, check in checks.items():
        try:
            check()
        except Exception as error:
            failures += 1
            reason = " ".join(str(error).split()) or type(error).__name__
            library = re.search(r"(\S+\.so[.0-9]*): cannot open shared object file", reason)
            fix = "; see docs/INSTALL.md for the system's packages" if library else ""
            print(f"Self-test: {what} failed: {reason}{fix}", file=sys.stderr)
    if not failures:
        print(f"Self-test: {len(checks)} checks passed in {time.monotonic() - begin:.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
