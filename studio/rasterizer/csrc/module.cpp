// The Python module studio.rasterizer._kernels. Arrays are passed by DLPack: torch tensors without a copy, and without
// linking to torch. This file checks array sizes, so that no call can read or write out of bounds. All other checks are
// in the Python wrappers (cpu.py, photometric.py).

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "buffers.h"
#include "errors.h"
#include "kernels.h"

namespace nb = nanobind;

namespace vs {

namespace {

template <typename T>
using In = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;
template <typename T>
using Out = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

std::vector<const Kernels*> supported() {
    std::vector<const Kernels*> found;
#if defined(VS_HAVE_X86_64_V3)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2"))
        found.push_back(&kernels_x86_64_v3);
#endif
    found.push_back(&kernels_baseline);
    return found;
}

const Kernels* kernels = supported().front();

template <typename A>
void expect(const A& array, std::size_t size, const char* name) {
    if (array.size() != size)
        throw std::invalid_argument(std::string(name) + " has " + std::to_string(array.size()) + " values, expected " +
                                    std::to_string(size));
}
template <typename A>
auto* pointer(const std::optional<A>& array, std::size_t size, const char* name) {
    if (!array) return static_cast<decltype(array->data())>(nullptr);
    expect(*array, size, name);
    return array->data();
}

template <typename T>
Splats<T> splats_of(const In<T>& means, const In<T>& quats, const In<T>& log_scales, const In<T>& logits,
                    const In<T>& sh, const std::optional<In<T>>& offsets) {
    Splats<T> s;
    const std::size_t n = logits.size();
    s.count = std::int64_t(n);
    s.coefficients = sh.ndim() == 3 ? int(sh.shape(1)) : 0;
    if (s.coefficients != 1 && s.coefficients != 4 && s.coefficients != 9 && s.coefficients != 16)
        throw std::invalid_argument("sh must be (N, 1, 4, 9 or 16, 3)");
    if (n > 0xfffffff0u) throw_too_many_tiles();
    expect(means, 3 * n, "means");
    expect(quats, 4 * n, "quats");
    expect(log_scales, 3 * n, "log_scales");
    expect(sh, 3 * n * s.coefficients, "sh");
    s.means = means.data();
    s.quats = quats.data();
    s.log_scales = log_scales.data();
    s.logits = logits.data();
    s.sh = sh.data();
    s.offsets = pointer(offsets, 2 * n, "offsets");
    return s;
}

// A new torch tensor whose memory is recycled when the tensor is freed.
template <typename T>
nb::ndarray<nb::pytorch, T> empty(const std::vector<std::size_t>& shape) {
    std::size_t count = 1;
    for (std::size_t side : shape) count *= side;
    auto buffer = std::make_unique<Buffer<T>>(count);
    T* data = buffer->get();
    nb::capsule owner(buffer.get(), [](void* p) noexcept { delete static_cast<Buffer<T>*>(p); });
    buffer.release();
    return nb::ndarray<nb::pytorch, T>(data, shape.size(), shape.data(), owner);
}

int checked_threads(int threads) {
    if (threads < 1) return 1;
    return threads > 256 ? 256 : threads;
}

template <typename T>
Frame<T>* forward(In<T> means, In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, std::optional<In<T>> offsets,
                  In<double> camera, int width, int height, double near, double alpha_max, In<T> background,
                  Out<T> image, Out<T> alpha, Out<T> depth, Out<T> radii, int threads) {
    const Splats<T> splats = splats_of<T>(means, quats, log_scales, logits, sh, offsets);
    if (width < 1 || height < 1 || width > 32000 || height > 32000)
        throw std::invalid_argument("the image must be from 1x1 to 32000x32000 pixels");
    expect(camera, 23, "camera");
    const std::size_t pixels = std::size_t(width) * std::size_t(height);
    expect(background, 3, "background");
    expect(image, 3 * pixels, "image");
    expect(alpha, pixels, "alpha");
    expect(depth, pixels, "depth");
    expect(radii, std::size_t(splats.count), "radii");
    auto frame = std::make_unique<Frame<T>>();
    Camera& c = frame->camera;
    const double* p = camera.data();
    for (int i = 0; i < 9; i++) c.rotation[i] = p[i];
    for (int i = 0; i < 3; i++) c.translation[i] = p[9 + i], c.center[i] = p[12 + i];
    c.fx = p[15], c.fy = p[16], c.cx = p[17], c.cy = p[18];
    for (int i = 0; i < 4; i++) c.limits[i] = p[19 + i];
    c.width = width, c.height = height, c.near = near, c.alpha_max = alpha_max;
    const Outputs<T> out = {background.data(), image.data(), alpha.data(), depth.data(), radii.data()};
    {
        nb::gil_scoped_release release;
        if constexpr (sizeof(T) == 4)
            kernels->forward_float(splats, out, *frame, checked_threads(threads));
        else
            kernels->forward_double(splats, out, *frame, checked_threads(threads));
    }
    return frame.release();
}

template <typename T>
void backward(const Frame<T>& frame, In<T> means, In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, In<T> image,
              In<T> alpha, In<T> depth, std::optional<In<T>> d_image, std::optional<In<T>> d_alpha,
              std::optional<In<T>> d_depth, Out<T> d_means, Out<T> d_quats, Out<T> d_log_scales, Out<T> d_logits,
              Out<T> d_sh, std::optional<Out<T>> d_offsets, int threads) {
    const Splats<T> splats = splats_of<T>(means, quats, log_scales, logits, sh, std::nullopt);
    if (splats.count != frame.count)
        throw std::invalid_argument("the number of splats differs from that of the forward pass");
    const std::size_t n = std::size_t(splats.count);
    const std::size_t pixels = std::size_t(frame.camera.width) * std::size_t(frame.camera.height);
    expect(image, 3 * pixels, "image");
    expect(alpha, pixels, "alpha");
    expect(depth, pixels, "depth");
    expect(d_means, 3 * n, "d_means");
    expect(d_quats, 4 * n, "d_quats");
    expect(d_log_scales, 3 * n, "d_log_scales");
    expect(d_logits, n, "d_logits");
    expect(d_sh, 3 * n * splats.coefficients, "d_sh");
    const Gradients<T> grad = {image.data(),
                               alpha.data(),
                               depth.data(),
                               pointer(d_image, 3 * pixels, "d_image"),
                               pointer(d_alpha, pixels, "d_alpha"),
                               pointer(d_depth, pixels, "d_depth"),
                               d_means.data(),
                               d_quats.data(),
                               d_log_scales.data(),
                               d_logits.data(),
                               d_sh.data(),
                               pointer(d_offsets, 2 * n, "d_offsets")};
    nb::gil_scoped_release release;
    if constexpr (sizeof(T) == 4)
        kernels->backward_float(splats, grad, frame, checked_threads(threads));
    else
        kernels->backward_double(splats, grad, frame, checked_threads(threads));
}

std::pair<double, double> loss(In<float> image, In<float> target, int width, int height, double dssim_weight,
                               std::optional<Out<float>> gradient, int threads) {
    if (width < 1 || height < 1) throw std::invalid_argument("the image is empty");
    const std::size_t floats = 3 * std::size_t(width) * std::size_t(height);
    expect(image, floats, "image");
    expect(target, floats, "target");
    LossJob job{width, height, image.data(), target.data(), dssim_weight, pointer(gradient, floats, "gradient"), 0, 0};
    nb::gil_scoped_release release;
    kernels->loss(job, checked_threads(threads));
    return {job.l1, job.ssim};
}

template <typename T>
void add(nb::module_& m, const char* frame_name) {
    nb::class_<Frame<T>>(m, frame_name, "What the backward pass needs from the forward pass.")
        .def_prop_ro("pairs", [](const Frame<T>& f) { return f.pairs; }, "Number of (tile, splat) pairs.");
    m.def("forward", &forward<T>, nb::arg("means").noconvert(), nb::arg("quats").noconvert(),
          nb::arg("log_scales").noconvert(), nb::arg("logits").noconvert(), nb::arg("sh").noconvert(),
          nb::arg("offsets").noconvert().none(), nb::arg("camera").noconvert(), nb::arg("width"), nb::arg("height"),
          nb::arg("near"), nb::arg("alpha_max"), nb::arg("background").noconvert(), nb::arg("image").noconvert(),
          nb::arg("alpha").noconvert(), nb::arg("depth").noconvert(), nb::arg("radii").noconvert(), nb::arg("threads"));
    m.def("backward", &backward<T>, nb::arg("frame"), nb::arg("means").noconvert(), nb::arg("quats").noconvert(),
          nb::arg("log_scales").noconvert(), nb::arg("logits").noconvert(), nb::arg("sh").noconvert(),
          nb::arg("image").noconvert(), nb::arg("alpha").noconvert(), nb::arg("depth").noconvert(),
          nb::arg("d_image").noconvert().none(), nb::arg("d_alpha").noconvert().none(),
          nb::arg("d_depth").noconvert().none(), nb::arg("d_means").noconvert(), nb::arg("d_quats").noconvert(),
          nb::arg("d_log_scales").noconvert(), nb::arg("d_logits").noconvert(), nb::arg("d_sh").noconvert(),
          nb::arg("d_offsets").noconvert().none(), nb::arg("threads"));
}

}  // namespace
}  // namespace vs

NB_MODULE(_kernels, m) {
    // An autograd graph may still hold a frame when the interpreter exits; that is not worth a leak warning.
    nb::set_leak_warnings(false);
    m.doc() = "C++ kernels of the CPU rasterizer and of the photometric loss; use studio.rasterizer instead.";
    vs::add<float>(m, "FrameFloat");
    vs::add<double>(m, "FrameDouble");
    m.def("loss", &vs::loss, nb::arg("image").noconvert(), nb::arg("target").noconvert(), nb::arg("width"),
          nb::arg("height"), nb::arg("dssim_weight"), nb::arg("gradient").noconvert().none(), nb::arg("threads"),
          "Mean absolute difference and mean SSIM; writes the gradient of (1 - w) L1 + w (1 - SSIM).");
    m.def("empty_float", &vs::empty<float>, nb::arg("shape"),
          "An uninitialized float32 torch tensor in recycled memory.");
    m.def("empty_double", &vs::empty<double>, nb::arg("shape"),
          "An uninitialized float64 torch tensor in recycled memory.");
    m.def(
        "instruction_sets",
        [] {
            std::vector<std::string> names;
            for (const vs::Kernels* k : vs::supported()) names.emplace_back(k->name);
            return names;
        },
        "Instruction sets that this machine supports, fastest first.");
    m.def("instruction_set", [] { return std::string(vs::kernels->name); }, "The instruction set in use.");
    m.def(
        "use_instruction_set",
        [](const std::string& name) {
            for (const vs::Kernels* k : vs::supported())
                if (name == k->name) {
                    vs::kernels = k;
                    return;
                }
            throw std::invalid_argument("unsupported instruction set: " + name);
        },
        nb::arg("name"), "Select one of instruction_sets(); for tests and measurements.");
    m.def("release_idle_buffers", &vs::release_idle_buffers,
          "Free the working memory that is kept for the next frame.");
}
