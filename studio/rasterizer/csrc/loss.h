// The photometric loss (1 - w) L1 + w (1 - SSIM) and its gradient in one sweep over the image. SSIM as in
// studio.metrics.ssim: 11x11 Gaussian window, sigma 1.5, zero padding.
//
// Each row passes through two ring buffers of eleven rows. The first holds x, y, x^2 + y^2 and x y, blurred along the
// row; its columns give SSIM and the partial derivatives of SSIM by those four means. The second holds the derivatives,
// blurred along the row; its columns give the gradient. RGB stays interleaved, so a neighboring pixel is three floats
// away.
#pragma once

#include <cstddef>
#include <cstdint>

#include "buffers.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

constexpr int TAPS = 11, HALF = 5, REACH = 3 * HALF, LOSS_LANES = WIDTH<float>;

struct LossWeights {
    float tap[HALF + 1];  // center first
};

// out[i] = sum_k tap_k in[i + 3 k]; `in` has REACH floats of padding on both sides
VS_INLINE void blur_row(const LossWeights& w, const float* in, float* out, int count) {
    for (int i = 0; i < count; i += LOSS_LANES) {
        WFloat s = w.tap[0] * load<float, WFloat>(in + i);
        for (int k = 1; k <= HALF; k++)
            s += w.tap[k] * (load<float, WFloat>(in + i - 3 * k) + load<float, WFloat>(in + i + 3 * k));
        store<float>(out + i, s);
    }
}

VS_INLINE WFloat blur_column(const LossWeights& w, float* const* ring, int i) {
    WFloat s = w.tap[0] * load<float, WFloat>(ring[HALF] + i);
    for (int k = 1; k <= HALF; k++)
        s += w.tap[k] * (load<float, WFloat>(ring[HALF - k] + i) + load<float, WFloat>(ring[HALF + k] + i));
    return s;
}

// Rows [begin, end) of the image: the gradient, and the sums of L1 and SSIM per row.
static void loss_band(const LossJob& job, const LossWeights& w, int begin, int end, float* scratch, double* row_l1,
                      double* row_ssim) {
    const int floats = 3 * job.width, stride = (floats + LOSS_LANES - 1) / LOSS_LANES * LOSS_LANES,
              padded_stride = stride + 2 * REACH + 2;
    const float c1 = 0.01f * 0.01f, c2 = 0.03f * 0.03f, n = float(floats) * float(job.height);
    const float l1_scale = float(1 - job.dssim_weight) / n, ssim_scale = float(-job.dssim_weight) / n;
    float* x_row = scratch + REACH;
    float* y_row = x_row + padded_stride;
    float* partial[3];
    for (int k = 0; k < 3; k++) partial[k] = y_row + (k + 1) * padded_stride;
    float* first_ring = scratch + 5 * padded_stride;      // [4][TAPS][wide]
    float* second_ring = first_ring + 4 * TAPS * stride;  // [3][TAPS][wide]
    auto slot = [](int row) { return (row + 4 * TAPS) % TAPS; };
    for (int i = 0; i < 5 * padded_stride; i++) scratch[i] = 0;

    for (int r = begin - 2 * HALF; r < end + 2 * HALF; r++) {
        // blur along row r
        float* blurred[4];
        for (int k = 0; k < 4; k++) blurred[k] = first_ring + (k * TAPS + slot(r)) * stride;
        if (r < 0 || r >= job.height) {
            for (int k = 0; k < 4; k++) __builtin_memset(blurred[k], 0, sizeof(float) * stride);
        } else {
            __builtin_memcpy(x_row, job.image + std::size_t(r) * floats, sizeof(float) * floats);
            __builtin_memcpy(y_row, job.target + std::size_t(r) * floats, sizeof(float) * floats);
            for (int i = 0; i < stride; i += LOSS_LANES) {
                WFloat x = load<float, WFloat>(x_row + i), y = load<float, WFloat>(y_row + i);
                WFloat sx = w.tap[0] * x, sy = w.tap[0] * y, ss = w.tap[0] * (x * x + y * y), sp = w.tap[0] * (x * y);
                for (int k = 1; k <= HALF; k++) {
                    WFloat xl = load<float, WFloat>(x_row + i - 3 * k), xr = load<float, WFloat>(x_row + i + 3 * k);
                    WFloat yl = load<float, WFloat>(y_row + i - 3 * k), yr = load<float, WFloat>(y_row + i + 3 * k);
                    sx += w.tap[k] * (xl + xr);
                    sy += w.tap[k] * (yl + yr);
                    ss += w.tap[k] * (xl * xl + xr * xr + yl * yl + yr * yr);
                    sp += w.tap[k] * (xl * yl + xr * yr);
                }
                store<float>(blurred[0] + i, sx);
                store<float>(blurred[1] + i, sy);
                store<float>(blurred[2] + i, ss);
                store<float>(blurred[3] + i, sp);
            }
        }

        // SSIM and its partial derivatives at row m
        const int m = r - HALF;
        if (m < begin - HALF) continue;
        float* blurred_again[3];
        for (int k = 0; k < 3; k++) blurred_again[k] = second_ring + (k * TAPS + slot(m)) * stride;
        if (m < 0 || m >= job.height) {
            for (int k = 0; k < 3; k++) __builtin_memset(blurred_again[k], 0, sizeof(float) * stride);
        } else {
            float* ring[4][TAPS];
            for (int k = 0; k < 4; k++)
                for (int j = 0; j < TAPS; j++) ring[k][j] = first_ring + (k * TAPS + slot(m - HALF + j)) * stride;
            double total = 0;
            for (int i = 0; i < stride; i += LOSS_LANES) {
                WFloat mx = blur_column(w, ring[0], i), my = blur_column(w, ring[1], i);
                WFloat squares = blur_column(w, ring[2], i), product = blur_column(w, ring[3], i);
                WFloat mm = mx * my, mxx_myy = mx * mx + my * my;
                WFloat a1 = 2.0f * mm + c1, a2 = 2.0f * (product - mm) + c2;
                WFloat b1 = mxx_myy + c1, b2 = squares - mxx_myy + c2;
                WFloat ib1 = 1.0f / b1, ib2 = 1.0f / b2, ib = ib1 * ib2;
                WFloat ssim = a1 * a2 * ib;
                if (i + LOSS_LANES > floats) {  // lanes past the end of the row do not count
                    for (int j = 0; j < LOSS_LANES; j++)
                        if (i + j >= floats) ssim[j] = mx[j] = my[j] = ib[j] = ib1[j] = ib2[j] = 0;
                }
                total += double(wide_sum<float>(ssim));
                if (job.gradient != nullptr) {
                    store<float>(partial[0] + i, 2.0f * (my * (a2 - a1) * ib - mx * ssim * (ib1 - ib2)));
                    store<float>(partial[1] + i, -ssim * ib2);
                    store<float>(partial[2] + i, 2.0f * a1 * ib);
                }
            }
            if (m >= begin && m < end) row_ssim[m] = total;
            if (job.gradient != nullptr)
                for (int k = 0; k < 3; k++) blur_row(w, partial[k], blurred_again[k], stride);
        }

        // the gradient at row o
        const int o = m - HALF;
        if (o < begin || o >= end) continue;
        float* ring[3][TAPS];
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < TAPS; j++) ring[k][j] = second_ring + (k * TAPS + slot(o - HALF + j)) * stride;
        const float *xs = job.image + std::size_t(o) * floats, *ys = job.target + std::size_t(o) * floats;
        double total = 0;
        for (int i = 0; i < stride; i += LOSS_LANES) {
            WFloat x{}, y{};
            const int valid = floats - i < LOSS_LANES ? floats - i : LOSS_LANES;
            if (valid == LOSS_LANES)
                x = load<float, WFloat>(xs + i), y = load<float, WFloat>(ys + i);
            else
                for (int j = 0; j < valid; j++) x[j] = xs[i + j], y[j] = ys[i + j];
            WFloat difference = x - y;
            WFloat size = difference < 0.0f ? -difference : difference;
            total += double(wide_sum<float>(size));
            if (job.gradient == nullptr) continue;
            const WFloat zero{};
            WFloat sign =
                difference > zero ? wide_all<float>(l1_scale) : (difference < zero ? wide_all<float>(-l1_scale) : zero);
            WFloat g =
                blur_column(w, ring[0], i) + 2.0f * x * blur_column(w, ring[1], i) + y * blur_column(w, ring[2], i);
            g = sign + ssim_scale * g;
            float* out = job.gradient + std::size_t(o) * floats + i;
            if (valid == LOSS_LANES)
                store<float>(out, g);
            else
                for (int j = 0; j < valid; j++) out[j] = g[j];
        }
        row_l1[o] = total;
    }
}

static void photometric_loss(LossJob& job, int threads) {
    LossWeights w;
    double taps[HALF + 1], total = 0;
    for (int k = 0; k <= HALF; k++) {
        taps[k] = __builtin_exp(-double(k * k) / (2 * 1.5 * 1.5));
        total += k == 0 ? taps[k] : 2 * taps[k];
    }
    for (int k = 0; k <= HALF; k++) w.tap[k] = float(taps[k] / total);

    // Each band recomputes twenty rows of its neighbors, so use no more bands than keep all threads busy.
    int bands = threads > 1 ? 2 * threads : 1;
    if (bands > job.height / 32 + 1) bands = job.height / 32 + 1;
    const int stride = (3 * job.width + LOSS_LANES - 1) / LOSS_LANES * LOSS_LANES,
              padded_stride = stride + 2 * REACH + 2;
    const std::size_t band_floats = std::size_t(5 * padded_stride + 7 * TAPS * stride + LOSS_LANES);
    Buffer<float> scratch(band_floats * bands);
    Buffer<double> rows(2 * std::size_t(job.height));
    double *row_l1 = rows.get(), *row_ssim = rows.get() + job.height;
    auto band = [&](int b) {
        loss_band(job, w, int(std::int64_t(job.height) * b / bands), int(std::int64_t(job.height) * (b + 1) / bands),
                  scratch.get() + band_floats * b, row_l1, row_ssim);
    };
    parallel_for(bands, threads, band);
    job.l1 = job.ssim = 0;
    for (int r = 0; r < job.height; r++) job.l1 += row_l1[r], job.ssim += row_ssim[r];
    const double n = 3.0 * job.width * job.height;
    job.l1 /= n;
    job.ssim /= n;
}

// Images over a background color.
VS_INLINE void over_pixels(const float* __restrict image, const float* __restrict rest, float red, float green,
                           float blue, float* __restrict out, std::int64_t pixels) {
    for (std::int64_t i = 0; i < pixels; i++) {
        out[3 * i] = image[3 * i] + rest[i] * red;
        out[3 * i + 1] = image[3 * i + 1] + rest[i] * green;
        out[3 * i + 2] = image[3 * i + 2] + rest[i] * blue;
    }
}

static void over_color(const OverJob& job, int threads) {
    constexpr std::int64_t BLOCK = 65536;
    auto block = [&](int task) {
        const std::int64_t begin = task * BLOCK, left = job.pixels - begin;
        over_pixels(job.image + 3 * begin, job.rest + begin, job.color[0], job.color[1], job.color[2],
                    job.out + 3 * begin, left < BLOCK ? left : BLOCK);
    };
    parallel_for(int((job.pixels + BLOCK - 1) / BLOCK), threads, block);
}

}  // namespace vs::VS_ISA
