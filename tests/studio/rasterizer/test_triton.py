"""The Triton backend: on the CPU in Triton's interpreter, compiled for GPUs, and, where there is one, on a GPU."""

from pathlib import Path

import pytest
import torch

from tests.studio.rasterizer.conftest import assert_same, draw, make_camera, make_splats, sturdy_pixels
from tests.support.errors import refuses
from tests.support.triton import compile_kernels, needs_triton, run_interpreted
from tests.support.warm_python import warm_python
from v3studio.studio.rasterizer import available_backends, preferred_device, rasterize, rasterize_views

pytestmark = pytest.mark.long


@needs_triton
def test_the_interpreted_kernels_against_the_reference() -> None:
    run_interpreted([Path(__file__).with_name("interpreted_triton.py")], 12)


@needs_triton
def test_the_kernels_compile_for_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    from v3studio.studio.rasterizer import triton_kernels
    from v3studio.studio.rasterizer.triton_backend import BACKWARD_WARPS, FORWARD_WARPS, PROJECT_WARPS

    types = {
        **dict.fromkeys(("owners", "last", "frames", "boxes", "ranks"), "*i32"),
        **dict.fromkeys(("starts", "slots", "ends", "keys"), "*i64"),
        **dict.fromkeys(("views", "count"), "i32"),
        **dict.fromkeys(("alpha_max", "near", "dilation"), "fp32"),
    }
    variants = {
        "project_splats": [{"COEFFICIENTS": 16, "OFFSETS": True}],
        "project_splats_backward": [
            {"COEFFICIENTS": 1, "PADDED": 1, "COLORS": False},
            {"COEFFICIENTS": 9, "PADDED": 16, "COLORS": True},
        ],
    }
    warps = {"blend_tile": FORWARD_WARPS, "blend_tile_backward": BACKWARD_WARPS, "sum_pairs": 1}
    compile_kernels(triton_kernels, types, {**warps, **dict.fromkeys(variants, PROJECT_WARPS)}, 80, variants)


@pytest.mark.parametrize("installed", [True, False])
def test_the_choice_on_a_gpu(installed: bool) -> None:
    """A new process is asked, since what is available is looked up once."""
    code = f"""
import importlib.util
import torch
from v3studio.studio.rasterizer import available_backends, preferred_device
find = importlib.util.find_spec
torch.cuda.is_available = lambda: True
importlib.util.find_spec = lambda name: ({installed} or None) if name == "triton" else find(name)
print(preferred_device().type, "triton" in available_backends())
"""
    ended = warm_python().run(("-c", code), text=True)
    assert ended.stdout == ("cuda True\n" if installed else "cpu False\n"), ended.stderr


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_triton_says_why_it_cannot() -> None:
    assert "triton" not in available_backends()
    assert preferred_device() == torch.device("cpu")
    with refuses("rasterizer.backend_unavailable", value="triton") as caught:
        rasterize(make_splats(1), make_camera(), backend="triton")
    assert "NVIDIA GPU" in caught.value.problem


@needs_triton
@pytest.mark.gpu
@pytest.mark.parametrize(("count", "degree", "log_scale"), [(0, 0, 0), (1, 0, -3), (300, 3, -1), (1500, 3, -3.5)])
def test_parity_on_the_gpu(count: int, degree: int, log_scale: float) -> None:
    camera, splats = make_camera(), make_splats(count, degree=degree, log_scale=log_scale)
    sturdy = sturdy_pixels(splats, camera)
    weight = sturdy.double()
    truth = draw(splats, camera, "reference", weight=weight)
    ours = draw(splats, camera, "triton", torch.float32, device="cuda", weight=weight)
    assert_same(ours, truth, where=sturdy)
    again = draw(splats, camera, "triton", torch.float32, device="cuda", weight=weight)
    assert torch.equal(again.image, ours.image)
    on_gpu = splats.to(torch.float32).map(lambda tensor: tensor.cuda())
    alone = rasterize(on_gpu, camera, backend="triton")
    both = rasterize_views(on_gpu, [make_camera(24, 20), camera], [None, None], backend="triton")
    assert torch.equal(both[1].image, alone.image)
    assert all(torch.equal(again.gradients[name], gradient) for name, gradient in ours.gradients.items())
