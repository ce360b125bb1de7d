// Splats of a frame of the stream's profile `motion`. The definition is studio/stream/decoders/motion.py.
//
// Compiled once, without fused multiply-add: positions have the same bits as in Python and in the browser, whatever the
// processor. So the order of the operations matters, too.
#define VS_ISA exact

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>

#include "arrays.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

struct DequantizeJob {
    std::int64_t count;
    int coefficients;                                 // of SH, K; there are C = 10 + 3 K channels
    const std::uint8_t* picture;
    const std::int32_t* pixels;                       // (N,) of each splat, relative to the first one of a channel
    const std::int64_t* first;                        // (C,)
    const float *steps, *offsets;                     // (C,)
    const std::int64_t* escape_starts;                // (C + 1,) first escape of each channel
    const std::int32_t* escape_splats;                // (E,) ascending within a channel
    const float* escape_codes;                        // (E,) instead of the pixels
    const float *gains, *keyframe, *local;            // (N,), (N, 3), (N, 4)
    const std::int32_t* labels;                       // (N,) rows of `maps` and `rotations`
    const float *maps, *rotations;                    // (B, 4, 3), (B, 4) quaternions; may be null: nothing moves
    float *means, *quats, *log_scales, *logits, *sh;  // results
};

constexpr int DEQUANTIZE_BLOCK = 256;  // splats whose channels fit into the cache; a multiple of LANES
constexpr int DEQUANTIZE_CHANNELS = 10;  // means, shapes, opacity; then 3 for each SH coefficient
constexpr float OPACITY_MARGIN = 1e-6f;  // as in attributes.py
constexpr int JACOBI_SWEEPS = 3;  // as in shapes.py
constexpr float SMALLEST_SCALE = 1e-12f;

// Values of one channel of the block's splats.
static void dequantize_channel(const DequantizeJob& job, int channel, std::int64_t begin, int n, float* out) {
    const std::uint8_t* picture = job.picture + job.first[channel];
    const std::int32_t* pixels = job.pixels + begin;
    for (int i = 0; i < n; i++) out[i] = float(picture[pixels[i]]);
    // escapes are sorted by channel, then by splat
    const std::int64_t low = job.escape_starts[channel], high = job.escape_starts[channel + 1];
    const std::int32_t* splats = job.escape_splats;
    for (std::int64_t e = std::lower_bound(splats + low, splats + high, std::int32_t(begin)) - splats; e < high; e++) {
        if (splats[e] >= begin + n) break;
        out[splats[e] - begin] = job.escape_codes[e];
    }
    const float step = job.steps[channel], offset = job.offsets[channel];
    for (int i = 0; i < n; i++) out[i] = out[i] * step + offset;
}

// One Jacobi rotation of each of the block's symmetric matrices: it makes the entry (P, Q) zero. `shape` has the
// entries in the order of the channels, `quat` what the axes were turned by so far, AROUND the component of the turn.
template <int P, int Q, int AROUND, int SIGN>
static void jacobi(float (*shape)[DEQUANTIZE_BLOCK], float (*quat)[DEQUANTIZE_BLOCK]) {
    constexpr int OTHER = 3 - P - Q, PQ = 2 + P + Q, OP = 2 + OTHER + P, OQ = 2 + OTHER + Q;
    constexpr int B = AROUND == 1 ? 2 : 1, C = AROUND == 3 ? 2 : 3;
    constexpr float FLIP = AROUND == 2 ? -1 : 1;
    for (int i = 0; i < DEQUANTIZE_BLOCK; i++) {
        const float across = shape[PQ][i], difference = shape[Q][i] - shape[P][i];
        const float reach = std::fabs(difference) +
                            std::sqrt(difference * difference + (2 * across) * (2 * across));
        float tangent = 2 * across / std::max(reach, std::numeric_limits<float>::min());
        tangent = difference < 0 ? -tangent : tangent;
        const float cosine = 1 / std::sqrt(1 + tangent * tangent), sine = tangent * cosine;
        shape[P][i] -= tangent * across;
        shape[Q][i] += tangent * across;
        shape[PQ][i] = 0;
        const float first = shape[OP][i], second = shape[OQ][i];
        shape[OP][i] = cosine * first - sine * second;
        shape[OQ][i] = sine * first + cosine * second;
        const float half = std::sqrt((1 + cosine) / 2), turn = SIGN * sine / (2 * half);
        const float w = quat[0][i], a = quat[AROUND][i], b = quat[B][i], c = quat[C][i];
        quat[0][i] = w * half - a * turn;
        quat[AROUND][i] = w * turn + a * half;
        quat[B][i] = b * half + FLIP * (c * turn);
        quat[C][i] = c * half - FLIP * (b * turn);
    }
}

static void dequantize_all(const DequantizeJob& job, int threads) {
    auto block = [&](int task) {
        const std::int64_t begin = std::int64_t(task) * DEQUANTIZE_BLOCK;
        const int n = int(std::min<std::int64_t>(DEQUANTIZE_BLOCK, job.count - begin));
        alignas(64) float value[6][DEQUANTIZE_BLOCK] = {}, turned[4][DEQUANTIZE_BLOCK] = {};
        for (int k = 0; k < 3; k++) dequantize_channel(job, k, begin, n, value[k]);
        for (int i = 0; i < n; i++) {
            const std::int64_t splat = begin + i;
            const float* keyframe = job.keyframe + 3 * splat;
            float moved[3] = {keyframe[0], keyframe[1], keyframe[2]};
            if (job.maps) {
                const float* map = job.maps + 12 * std::int64_t(job.labels[splat]);
                const float* local = job.local + 4 * splat;
                for (int k = 0; k < 3; k++)
                    moved[k] += ((map[9 + k] + local[0] * map[k]) + local[1] * map[3 + k]) + local[2] * map[6 + k];
            }
            for (int k = 0; k < 3; k++) job.means[3 * splat + k] = moved[k] + value[k][i] * job.gains[splat];
        }

        for (int k = 0; k < 6; k++) dequantize_channel(job, 3 + k, begin, n, value[k]);
        for (int i = 0; i < n; i++) turned[0][i] = 1;
        for (int sweep = 0; sweep < JACOBI_SWEEPS; sweep++) {
            jacobi<0, 1, 3, -1>(value, turned);
            jacobi<0, 2, 2, 1>(value, turned);
            jacobi<1, 2, 1, -1>(value, turned);
        }
        for (int i = 0; i < n; i++) {
            const std::int64_t splat = begin + i;
            const float b[4] = {turned[0][i], turned[1][i], turned[2][i], turned[3][i]};
            float* quat = job.quats + 4 * splat;
            if (job.rotations) {
                const float* a = job.rotations + 4 * std::int64_t(job.labels[splat]);
                quat[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
                quat[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
                quat[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
                quat[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
            } else {
                for (int k = 0; k < 4; k++) quat[k] = b[k];
            }
        }
        for (int k = 0; k < 3; k++) {
            for (int i = 0; i < n; i += LANES) {
                const VFloat root = load<float>(value[k] + i);
                const VFloat scale = vmax<float>(root * root, broadcast<float>(SMALLEST_SCALE));
                store<float>(value[k] + i, 0.69314718f * vlog2(scale));
            }
            for (int i = 0; i < n; i++) job.log_scales[3 * (begin + i) + k] = value[k][i];
        }

        dequantize_channel(job, 9, begin, n, value[0]);
        const VFloat low = broadcast<float>(OPACITY_MARGIN), high = broadcast<float>(1 - OPACITY_MARGIN);
        for (int i = 0; i < n; i += LANES) {
            const VFloat opacity = vmin<float>(vmax<float>(load<float>(value[0] + i), low), high);
            store<float>(value[0] + i, 0.69314718f * (vlog2(opacity) - vlog2(1.0f - opacity)));
        }
        for (int i = 0; i < n; i++) job.logits[begin + i] = value[0][i];

        for (int c = 0; c < job.coefficients; c++) {
            for (int k = 0; k < 3; k++)
                dequantize_channel(job, DEQUANTIZE_CHANNELS + 3 * c + k, begin, n, value[k]);  // luma, orange, green
            for (int i = 0; i < n; i++) {
                float* sh = job.sh + 3 * ((begin + i) * job.coefficients + c);
                sh[0] = value[0][i] + value[1][i] - value[2][i];
                sh[1] = value[0][i] + value[2][i];
                sh[2] = value[0][i] - value[1][i] - value[2][i];
            }
        }
    };
    parallel_for(int((job.count + DEQUANTIZE_BLOCK - 1) / DEQUANTIZE_BLOCK), threads, block);
}

}  // namespace vs::VS_ISA

namespace vs {

namespace {

// The largest of some indices; throws if one is negative.
std::int64_t largest(const In<std::int32_t>& indices, const char* name) {
    std::int32_t low = 0, high = -1;
    for (std::size_t i = 0; i < indices.size(); i++) {
        low = indices.data()[i] < low ? indices.data()[i] : low;
        high = indices.data()[i] > high ? indices.data()[i] : high;
    }
    if (low < 0) throw std::invalid_argument(std::string(name) + " has a negative value");
    return high;
}

void dequantize(In<std::uint8_t> picture, In<std::int32_t> pixels, In<std::int64_t> first, In<float> steps,
                In<float> offsets, In<std::int64_t> escape_starts, In<std::int32_t> escape_splats,
                In<float> escape_codes, In<float> gains, In<float> keyframe, In<float> local, In<std::int32_t> labels,
                std::optional<In<float>> maps, std::optional<In<float>> rotations, Out<float> means, Out<float> quats,
                Out<float> log_scales, Out<float> logits, Out<float> sh, int threads) {
    const std::size_t n = pixels.size(), channels = first.size();
    if (channels < 13 || (channels - 10) % 3) throw std::invalid_argument("there must be 10 + 3 K channels");
    const std::size_t coefficients = (channels - 10) / 3;
    const std::int64_t most = largest(pixels, "pixels");
    for (std::size_t c = 0; c < channels; c++)
        if (first.data()[c] < 0 || first.data()[c] + most >= std::int64_t(picture.size()))
            throw std::invalid_argument("a channel is outside the picture");
    expect(steps, channels, "steps");
    expect(offsets, channels, "offsets");
    expect(escape_starts, channels + 1, "escape_starts");
    expect(escape_codes, escape_splats.size(), "escape_codes");
    for (std::size_t c = 0; c < channels; c++)
        if (escape_starts.data()[c] < 0 || escape_starts.data()[c] > escape_starts.data()[c + 1] ||
            escape_starts.data()[c + 1] > std::int64_t(escape_splats.size()))
            throw std::invalid_argument("escape_starts must ascend");
    if (largest(escape_splats, "escape_splats") >= std::int64_t(n))
        throw std::invalid_argument("an escape is outside the group");
    expect(gains, n, "gains");
    expect(keyframe, 3 * n, "keyframe");
    expect(local, 4 * n, "local");
    expect(labels, n, "labels");
    const std::size_t blocks = std::size_t(largest(labels, "labels") + 1);
    if ((maps && maps->size() < 12 * blocks) || (rotations && rotations->size() < 4 * blocks))
        throw std::invalid_argument("a label is outside the blocks");
    expect(means, 3 * n, "means");
    expect(quats, 4 * n, "quats");
    expect(log_scales, 3 * n, "log_scales");
    expect(logits, n, "logits");
    expect(sh, 3 * coefficients * n, "sh");
    const VS_ISA::DequantizeJob job = {std::int64_t(n), int(coefficients), picture.data(), pixels.data(), first.data(),
                               steps.data(), offsets.data(), escape_starts.data(), escape_splats.data(),
                               escape_codes.data(), gains.data(), keyframe.data(), local.data(), labels.data(),
                               maps ? maps->data() : nullptr, rotations ? rotations->data() : nullptr, means.data(),
                               quats.data(), log_scales.data(), logits.data(), sh.data()};
    nb::gil_scoped_release release;
    VS_ISA::dequantize_all(job, checked_threads(threads));
}

}  // namespace

void add_dequantize(nb::module_& m) {
    m.def("dequantize", &dequantize, array("picture"), array("pixels"), array("first"), array("steps"),
          array("offsets"), array("escape_starts"), array("escape_splats"), array("escape_codes"), array("gains"),
          array("keyframe"), array("local"), array("labels"), array("maps").none(), array("rotations").none(),
          array("means"), array("quats"), array("log_scales"), array("logits"), array("sh"), nb::arg("threads"),
          "Splats of a frame of the profile `motion`.");
}

}  // namespace vs
