// The Python module studio.rasterizer._kernels. Arrays are passed by DLPack: torch tensors without a copy, and without
// linking to torch. This file and dequantize.cpp check array sizes, so that no call can read or write out of bounds. All
// other checks are in the Python wrappers (cpu.py, and those in studio/training).

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

#include "arrays.h"
#include "buffers.h"
#include "kernels.h"

namespace vs {

namespace {

std::vector<const Kernels*> supported() {
    std::vector<const Kernels*> found;
#if defined(VS_HAVE_X86_64)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512cd") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        found.push_back(&kernels_x86_64_v4);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2"))
        found.push_back(&kernels_x86_64_v3);
#endif
    found.push_back(&kernels_baseline);
    return found;
}

const Kernels* kernels = supported().front();

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

template <typename T>
Frame<T>* forward(In<T> means, In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, std::optional<In<T>> offsets,
                  In<double> camera, int width, int height, double near, double alpha_max, double dilation,
                  In<T> background, Out<T> image, Out<T> alpha, Out<T> depth, Out<T> radii, int threads) {
    const Splats<T> splats = splats_of<T>(means, quats, log_scales, logits, sh, offsets);
    if (width < 1 || height < 1 || width > 32000 || height > 32000)
        throw std::invalid_argument("the image must be from 1x1 to 32000x32000 pixels");
    expect(camera, 23, "camera");
    const std::size_t pixels = std::size_t(width) * std::size_t(height);
    if (background.size() != 3) expect(background, 3 * pixels, "background");
    expect(image, 3 * pixels, "image");
    expect(alpha, pixels, "alpha");
    expect(depth, pixels, "depth");
    expect(radii, std::size_t(splats.count), "radii");
    auto frame = std::make_unique<Frame<T>>();
    frame->kernels = kernels;
    Camera& c = frame->camera;
    const double* p = camera.data();
    for (int i = 0; i < 9; i++) c.rotation[i] = p[i];
    for (int i = 0; i < 3; i++) c.translation[i] = p[9 + i], c.center[i] = p[12 + i];
    c.fx = p[15], c.fy = p[16], c.cx = p[17], c.cy = p[18];
    for (int i = 0; i < 4; i++) c.limits[i] = p[19 + i];
    c.width = width, c.height = height, c.near = near, c.alpha_max = alpha_max, c.dilation = dilation;
    const Outputs<T> out = {background.data(), background.size() == 3 ? 0 : 3, image.data(), alpha.data(), depth.data(),
                            radii.data()};
    nb::gil_scoped_release release;
    kernels->of<T>().forward(splats, out, *frame, checked_threads(threads));
    return frame.release();
}

template <typename T>
void backward(const Frame<T>& frame, In<T> means, In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, In<T> image,
              In<T> alpha, In<T> depth, std::optional<In<T>> d_image, std::optional<In<T>> d_alpha,
              std::optional<In<T>> d_depth, std::optional<Out<T>> d_means, std::optional<Out<T>> d_quats,
              std::optional<Out<T>> d_log_scales, std::optional<Out<T>> d_logits, std::optional<Out<T>> d_sh,
              std::optional<Out<T>> d_offsets, int threads) {
    const Splats<T> splats = splats_of<T>(means, quats, log_scales, logits, sh, std::nullopt);
    if (splats.count != frame.count)
        throw std::invalid_argument("the number of splats differs from that of the forward pass");
    const std::size_t n = std::size_t(splats.count);
    const std::size_t pixels = std::size_t(frame.camera.width) * std::size_t(frame.camera.height);
    expect(image, 3 * pixels, "image");
    expect(alpha, pixels, "alpha");
    expect(depth, pixels, "depth");
    const Gradients<T> grad = {image.data(),
                               alpha.data(),
                               depth.data(),
                               pointer(d_image, 3 * pixels, "d_image"),
                               pointer(d_alpha, pixels, "d_alpha"),
                               pointer(d_depth, pixels, "d_depth"),
                               pointer(d_means, 3 * n, "d_means"),
                               pointer(d_quats, 4 * n, "d_quats"),
                               pointer(d_log_scales, 3 * n, "d_log_scales"),
                               pointer(d_logits, n, "d_logits"),
                               pointer(d_sh, 3 * n * splats.coefficients, "d_sh"),
                               pointer(d_offsets, 2 * n, "d_offsets")};
    nb::gil_scoped_release release;
    frame.kernels->template of<T>().backward(splats, grad, frame, checked_threads(threads));
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

void over(In<float> image, In<float> rest, In<float> color, Out<float> out, int threads) {
    const std::size_t pixels = rest.size();
    expect(image, 3 * pixels, "image");
    expect(color, 3, "color");
    expect(out, 3 * pixels, "out");
    const OverJob job{std::int64_t(pixels), image.data(), rest.data(), color.data(), out.data()};
    nb::gil_scoped_release release;
    kernels->over(job, checked_threads(threads));
}

// The activations of a forward pass of the motion field.
template <typename T>
struct FieldPass {
    FieldShape shape;
    std::int64_t count;
    Buffer<T> activations;
};

template <typename T>
FieldJob<T> field_job(const In<std::int32_t>& rows, const In<T>& corner_weights, const In<std::int64_t>& level_rows,
                      const In<T>& table, const std::vector<In<T>>& weights, const std::vector<In<T>>& biases,
                      double scale) {
    FieldJob<T> job{};
    if (rows.ndim() != 3 || rows.shape(2) != 8 || table.ndim() != 2)
        throw std::invalid_argument("rows must be (L, N, 8) and table (rows, F)");
    FieldShape& shape = job.shape;
    shape.levels = int(rows.shape(0));
    job.count = std::int64_t(rows.shape(1));
    shape.features = int(table.shape(1));
    shape.layers = int(weights.size()) - 1;
    if (shape.features < 1 || shape.features > 16 || shape.layers < 1 || shape.layers > MAX_FIELD_LAYERS ||
        biases.size() != weights.size())
        throw std::invalid_argument("the motion network has 1 to 16 features and 1 to 8 hidden layers");
    shape.hidden = int(biases[0].size());
    expect(corner_weights, rows.size(), "corner_weights");
    expect(level_rows, std::size_t(shape.levels) + 1, "level_rows");
    for (std::size_t l = 0; l < weights.size(); l++) {
        const std::size_t inputs = std::size_t(l == 0 ? shape.levels * shape.features : shape.hidden);
        const std::size_t outputs = std::size_t(l + 1 == weights.size() ? 3 : shape.hidden);
        expect(weights[l], inputs * outputs, "weights");
        expect(biases[l], outputs, "biases");
        job.weights[l] = weights[l].data();
        job.biases[l] = biases[l].data();
    }
    job.rows = rows.data();
    job.corner_weights = corner_weights.data();
    job.level_rows = level_rows.data();
    // The rows themselves are not checked in each call: HashGrid.corners makes them.
    if (job.level_rows[0] != 0 || std::size_t(job.level_rows[shape.levels]) != table.shape(0))
        throw std::invalid_argument("level_rows does not match the table");
    job.table = table.data();
    job.scale = T(scale);
    return job;
}

template <typename T>
FieldPass<T>* field_forward(In<std::int32_t> rows, In<T> corner_weights, In<std::int64_t> level_rows, In<T> table,
                            std::vector<In<T>> weights, std::vector<In<T>> biases, double scale, Out<T> out,
                            int threads) {
    const FieldJob<T> job = field_job<T>(rows, corner_weights, level_rows, table, weights, biases, scale);
    expect(out, 3 * std::size_t(job.count), "out");
    auto pass = std::make_unique<FieldPass<T>>(FieldPass<T>{job.shape, job.count, {}});
    nb::gil_scoped_release release;
    kernels->of<T>().field_forward(job, pass->activations, out.data(), checked_threads(threads));
    return pass.release();
}

template <typename T>
void field_backward(const FieldPass<T>& pass, In<std::int32_t> rows, In<T> corner_weights, In<std::int64_t> level_rows,
                    In<T> table, std::vector<In<T>> weights, std::vector<In<T>> biases, double scale, In<T> d_out,
                    Out<T> d_table, std::vector<Out<T>> d_weights, std::vector<Out<T>> d_biases, int threads) {
    const FieldJob<T> job = field_job<T>(rows, corner_weights, level_rows, table, weights, biases, scale);
    if (job.count != pass.count || job.shape.levels != pass.shape.levels || job.shape.hidden != pass.shape.hidden ||
        job.shape.features != pass.shape.features || job.shape.layers != pass.shape.layers)
        throw std::invalid_argument("the motion field differs from that of the forward pass");
    FieldGradients<T> grad{};
    expect(d_out, 3 * std::size_t(job.count), "d_out");
    expect(d_table, table.size(), "d_table");
    if (d_weights.size() != weights.size() || d_biases.size() != biases.size())
        throw std::invalid_argument("one gradient per layer is required");
    for (std::size_t l = 0; l < weights.size(); l++) {
        expect(d_weights[l], weights[l].size(), "d_weights");
        expect(d_biases[l], biases[l].size(), "d_biases");
        grad.d_weights[l] = d_weights[l].data();
        grad.d_biases[l] = d_biases[l].data();
    }
    grad.d_out = d_out.data();
    grad.d_table = d_table.data();
    nb::gil_scoped_release release;
    kernels->of<T>().field_backward(job, pass.activations, grad, checked_threads(threads));
}

template <typename T>
std::pair<double, double> coded_loss(In<T> current, In<T> previous, In<T> steps, In<T> mu, In<T> sigma, std::uint32_t seed,
                                     double bits_weight, double difference_weight,
                                     std::optional<Out<T>> gradient, Out<double> by_mu, Out<double> by_sigma,
                                     int threads) {
    CodedJob<T> job{};
    if (current.ndim() != 2 || current.shape(1) < 1) throw std::invalid_argument("current must be (N, C)");
    job.count = std::int64_t(current.shape(0));
    const std::size_t channels = current.shape(1);
    job.channels = int(channels);
    expect(previous, current.size(), "previous");
    expect(steps, channels, "steps");
    expect(mu, channels, "mu");
    expect(sigma, channels, "sigma");
    expect(by_mu, channels, "by_mu");
    expect(by_sigma, channels, "by_sigma");
    job.current = current.data(), job.previous = previous.data();
    job.steps = steps.data(), job.mu = mu.data(), job.sigma = sigma.data();
    job.seed = seed;
    job.bits_weight = T(bits_weight), job.difference_weight = T(difference_weight);
    job.gradient = pointer(gradient, current.size(), "gradient");
    job.by_mu = by_mu.data(), job.by_sigma = by_sigma.data();
    nb::gil_scoped_release release;
    kernels->of<T>().coded_loss(job, checked_threads(threads));
    return {job.bits, job.difference};
}

template <typename T>
PlanesJob<T> planes_job(const In<T>& quats, const In<T>& log_scales, const In<T>& logits, const In<T>& sh,
                        const In<T>& reference) {
    const std::size_t n = logits.size();
    if (sh.ndim() != 3 || sh.shape(1) < 1) throw std::invalid_argument("sh must be (N, K, 3)");
    expect(quats, 4 * n, "quats");
    expect(log_scales, 3 * n, "log_scales");
    expect(sh, 3 * n * sh.shape(1), "sh");
    expect(reference, 4 * n, "reference");
    return {std::int64_t(n), int(sh.shape(1)), quats.data(),    log_scales.data(),
            logits.data(),   sh.data(),        reference.data()};
}

template <typename T>
void planes_values(In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, In<T> reference, Out<T> values, int threads) {
    const PlanesJob<T> job = planes_job<T>(quats, log_scales, logits, sh, reference);
    expect(values, std::size_t(job.count) * std::size_t(8 + 3 * job.coefficients), "values");
    nb::gil_scoped_release release;
    kernels->of<T>().planes_values(job, values.data(), checked_threads(threads));
}

template <typename T>
void planes_gradients(In<T> quats, In<T> log_scales, In<T> logits, In<T> sh, In<T> reference, In<T> values,
                      In<T> d_values, Out<T> d_quats, Out<T> d_log_scales, Out<T> d_logits, Out<T> d_sh, int threads) {
    const PlanesJob<T> job = planes_job<T>(quats, log_scales, logits, sh, reference);
    const std::size_t size = std::size_t(job.count) * std::size_t(8 + 3 * job.coefficients);
    expect(values, size, "values");
    expect(d_values, size, "d_values");
    expect(d_quats, quats.size(), "d_quats");
    expect(d_log_scales, log_scales.size(), "d_log_scales");
    expect(d_logits, logits.size(), "d_logits");
    expect(d_sh, sh.size(), "d_sh");
    const PlanesGradients<T> grad = {values.data(),       d_values.data(), d_quats.data(),
                                     d_log_scales.data(), d_logits.data(), d_sh.data()};
    nb::gil_scoped_release release;
    kernels->of<T>().planes_gradients(job, grad, checked_threads(threads));
}

template <typename T>
void dropout(In<T> logits, double share, std::uint32_t seed, Out<T> out, Out<T> derivative, int threads) {
    expect(out, logits.size(), "out");
    expect(derivative, logits.size(), "derivative");
    const DropoutJob<T> job = {std::int64_t(logits.size()), logits.data(), share, seed, out.data(), derivative.data()};
    nb::gil_scoped_release release;
    kernels->of<T>().dropout(job, checked_threads(threads));
}

template <typename T>
void add_training(nb::module_& m, const char* pass_name) {
    nb::class_<FieldPass<T>>(m, pass_name, "What the backward pass of the motion field needs from the forward pass.");
    m.def("field_forward", &field_forward<T>, array("rows"), array("corner_weights"), array("level_rows"),
          array("table"), array("weights"), array("biases"), nb::arg("scale"), array("out"), nb::arg("threads"));
    m.def("field_backward", &field_backward<T>, nb::arg("pass"), array("rows"), array("corner_weights"),
          array("level_rows"), array("table"), array("weights"), array("biases"), nb::arg("scale"), array("d_out"),
          array("d_table"), array("d_weights"), array("d_biases"), nb::arg("threads"));
    m.def("coded_loss", &coded_loss<T>, array("current"), array("previous"), array("steps"), array("mu"),
          array("sigma"), nb::arg("seed"), nb::arg("bits_weight"), nb::arg("difference_weight"),
          array("gradient").none(), array("by_mu"), array("by_sigma"), nb::arg("threads"),
          "Sums of bits and differences; writes the gradient of their weighted sum.");
    m.def("planes_values", &planes_values<T>, array("quats"), array("log_scales"), array("logits"), array("sh"),
          array("reference"), array("values"), nb::arg("threads"));
    m.def("planes_gradients", &planes_gradients<T>, array("quats"), array("log_scales"), array("logits"), array("sh"),
          array("reference"), array("values"), array("d_values"), array("d_quats"), array("d_log_scales"),
          array("d_logits"), array("d_sh"), nb::arg("threads"));
    m.def("dropout", &dropout<T>, array("logits"), nb::arg("share"), nb::arg("seed"), array("out"), array("derivative"),
          nb::arg("threads"));
}

template <typename T>
void add(nb::module_& m, const char* frame_name) {
    nb::class_<Frame<T>>(m, frame_name, "What the backward pass needs from the forward pass.");
    m.def("forward", &forward<T>, array("means"), array("quats"), array("log_scales"), array("logits"), array("sh"),
          array("offsets").none(), array("camera"), nb::arg("width"), nb::arg("height"), nb::arg("near"),
          nb::arg("alpha_max"), nb::arg("dilation"), array("background"), array("image"), array("alpha"),
          array("depth"), array("radii"), nb::arg("threads"));
    m.def("backward", &backward<T>, nb::arg("frame"), array("means"), array("quats"), array("log_scales"),
          array("logits"), array("sh"), array("image"), array("alpha"), array("depth"), array("d_image").none(),
          array("d_alpha").none(), array("d_depth").none(), array("d_means").none(), array("d_quats").none(),
          array("d_log_scales").none(), array("d_logits").none(), array("d_sh").none(), array("d_offsets").none(),
          nb::arg("threads"));
}

}  // namespace
}  // namespace vs

NB_MODULE(_kernels, m) {
    using vs::array;
    // An autograd graph may still hold a frame when the interpreter exits; that is not worth a leak warning.
    nb::set_leak_warnings(false);
    m.attr("interface") = 4;  // as KERNEL_INTERFACE in cpu.py: raise both when functions or their arguments change
    m.doc() = "C++ kernels of the CPU rasterizer and of training; use v3studio.studio.rasterizer and v3studio.studio.training instead.";
    vs::add<float>(m, "FrameFloat");
    vs::add<double>(m, "FrameDouble");
    vs::add_training<float>(m, "FieldPassFloat");
    vs::add_training<double>(m, "FieldPassDouble");
    m.def("loss", &vs::loss, array("image"), array("target"), nb::arg("width"), nb::arg("height"),
          nb::arg("dssim_weight"), array("gradient").none(), nb::arg("threads"),
          "Mean absolute difference and mean SSIM; writes the gradient of (1 - w) L1 + w (1 - SSIM).");
    m.def("over", &vs::over, array("image"), array("rest"), array("color"), array("out"), nb::arg("threads"),
          "out = image + rest * color, per pixel.");
    vs::add_dequantize(m);
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
}
