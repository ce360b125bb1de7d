// Lets Python call the CPU rasterizer of an OpenSplat checkout, see opensplat_peer.py. Only declarations of its header
// `bindings.h` are used; nothing of OpenSplat is in this repository.
#include <torch/extension.h>

#include "bindings.h"

namespace {

using Lists = std::vector<int32_t>;  // per pixel, the splats that were blended

auto project(torch::Tensor means, torch::Tensor scales, torch::Tensor quats, torch::Tensor view, torch::Tensor projection,
             float fx, float fy, float cx, float cy, unsigned height, unsigned width, float near) {
    return project_gaussians_forward_tensor_cpu(static_cast<int>(means.size(0)), means, scales, 1.0f, quats, view,
                                                projection, fx, fy, cx, cy, height, width, near);
}

auto forward(int width, int height, const torch::Tensor &centers, const torch::Tensor &conics,
             const torch::Tensor &colors, const torch::Tensor &opacities, const torch::Tensor &background,
             const torch::Tensor &covariances, const torch::Tensor &depths) {
    auto [image, transmittance, lists] = rasterize_forward_tensor_cpu(width, height, centers, conics, colors, opacities,
                                                                      background, covariances, depths);
    return std::make_tuple(image, transmittance, reinterpret_cast<uintptr_t>(lists));
}

auto backward(int height, int width, const torch::Tensor &centers, const torch::Tensor &conics,
              const torch::Tensor &colors, const torch::Tensor &opacities, const torch::Tensor &background,
              const torch::Tensor &covariances, const torch::Tensor &depths, const torch::Tensor &transmittance,
              uintptr_t lists, const torch::Tensor &d_image, const torch::Tensor &d_alpha) {
    return rasterize_backward_tensor_cpu(height, width, centers, conics, colors, opacities, background, covariances,
                                         depths, transmittance, reinterpret_cast<Lists *>(lists), d_image, d_alpha);
}

void release(uintptr_t lists) { delete[] reinterpret_cast<Lists *>(lists); }

}  // namespace

PYBIND11_MODULE(TORCH_EXTENSION_NAME, module) {
    module.def("project", &project);
    module.def("forward", &forward);
    module.def("backward", &backward);
    module.def("release", &release);
    module.def("harmonics", [](int degree, const torch::Tensor &directions, const torch::Tensor &sh) {
        return compute_sh_forward_tensor_cpu(static_cast<int>(sh.size(0)), degree, degree, directions, sh);
    });
}
