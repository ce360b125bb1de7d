// Backward pass: gradients at the pixels of a tile, then from the projected splats to their attributes.
#pragma once

#include <cstddef>
#include <cstdint>

#include "attributes.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "pixel_lanes.h"
#include "project.h"
#include "simd.h"
#include "tiles.h"

namespace vs::VS_ISA {

// Contents of a slot: sums over the pixels of one tile for one splat. q is dLoss/d(ln alpha); u and v as in Projected.
enum Slot { S_Q, S_QU, S_QUU, S_QV, S_QUV, S_QVV, S_RED, S_GREEN, S_BLUE, S_DEPTH };

// State of the pixels of a block. With T the transmittance, g the gradient of the color and S the sum over everything
// behind a splat of (blended color . g), dLoss/dalpha = T (color . g) - S / (1 - alpha). S starts with the whole pixel
// and shrinks from front to back.
// Which outputs besides the image have a gradient. Training compares alpha with the mask; nothing in it uses depth.
enum GradientsOf { IMAGE, IMAGE_ALPHA, IMAGE_ALPHA_DEPTH };

// Which sums over pixels are needed. SHAPE: not those for opacities and colors, which motion does not train.
enum SumsFor { EVERYTHING, SHAPE };

template <typename T, GradientsOf USED>
struct BackwardPixel {
    PixelVec<T> transmittance, behind, red, green, blue;  // behind is S; the colors are gradients
};
template <typename T>
struct BackwardPixel<T, IMAGE_ALPHA> {
    PixelVec<T> transmittance, behind, red, green, blue, alpha;
};
template <typename T>
struct BackwardPixel<T, IMAGE_ALPHA_DEPTH> {
    PixelVec<T> transmittance, behind, red, green, blue, alpha, depth, rendered_depth;
};

template <typename T, GradientsOf USED, SumsFor NEEDED>
static void backward_tile(const Frame<T>& frame, const TileBox& box, const Intersection<T>* list, std::uint32_t count,
                          const Gradients<T>& grad, T* slots, int tile, std::uint64_t* kept) {
    using L = PixelLanes<T>;
    using V = typename L::V;
    using M = typename L::M;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    BackwardPixel<T, USED> pixels[BLOCKS<T>];
    PixelGrid<T> grid;
    PixelGrid<T>::init(grid);
    BlockSet<T> active = init_pixels<T>(box, grid, pixels);
    if (box.width < TILE || box.height < TILE)
        for (BackwardPixel<T, USED>& pixel : pixels) {
            pixel.behind = pixel.red = pixel.green = pixel.blue = V{};
            if constexpr (USED >= IMAGE_ALPHA) pixel.alpha = V{};
            if constexpr (USED == IMAGE_ALPHA_DEPTH) pixel.depth = pixel.rendered_depth = V{};
        }
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H<T>)*BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H<T> * BLOCK_W + x % BLOCK_W;
            const std::int64_t here = row + x;
            BackwardPixel<T, USED>& pixel = pixels[i];
            T gr = 0, gg = 0, gb = 0;
            if (grad.d_image != nullptr)
                gr = grad.d_image[3 * here], gg = grad.d_image[3 * here + 1], gb = grad.d_image[3 * here + 2];
            pixel.red[lane] = gr, pixel.green[lane] = gg, pixel.blue[lane] = gb;
            T rest = grad.image[3 * here] * gr + grad.image[3 * here + 1] * gg + grad.image[3 * here + 2] * gb;
            if constexpr (USED >= IMAGE_ALPHA) {
                const T ga = grad.d_alpha != nullptr ? grad.d_alpha[here] : T(0);
                pixel.alpha[lane] = ga;
                rest += grad.alpha[here] * ga;
            }
            if constexpr (USED == IMAGE_ALPHA_DEPTH) {
                // depth = sum(w z) / sum(w), so a splat of depth z has d(depth)/dw = (z - depth) / sum(w)
                const T alpha = grad.alpha[here];
                pixel.depth[lane] = grad.d_depth != nullptr && alpha > 0 ? grad.d_depth[here] / alpha : T(0);
                pixel.rendered_depth[lane] = grad.depth[here];
            }
            pixel.behind[lane] = rest;
        }
    }
    const V alpha_min_log2 = L::all(T(ALPHA_MIN_LOG2)), alpha_max = L::all(T(camera.alpha_max)),
            transmittance_min = L::all(T(TRANSMITTANCE_MIN));
    const int tile_x = tile % frame.tiles_x, tile_y = tile / frame.tiles_x;
    auto slot_of = [&](const Projected<T>& p) {
        const int tiles_across = p.right / TILE - p.left / TILE + 1;
        return slots + SLOT * (std::size_t(p.slot) +
                               std::size_t((tile_y - p.top / TILE) * tiles_across + tile_x - p.left / TILE));
    };
    Batch<T> batch;
    for (std::uint32_t n = 0; n < count;) {
        const std::uint32_t start = n;
        n = batch.template fill<false>(projected, list, n, count, box, active, kept);
        // The slots of splats that touch no active pixel stay zero.
        for (std::uint32_t k = start; k < n; k++) {
            T* slot = slot_of(projected[list[k].splat]);
            for (int i = 0; i < SLOT; i++) slot[i] = 0;
        }
        for (int k = 0; k < batch.size; k++) {
            const Projected<T>& p = *batch.splats[k];
            const BlockSet<T> touched = batch.touched[k];
            T* slot = slot_of(p);
            const SplatInTile<T> shape = SplatInTile<T>::of(p, box);
            const V r = L::all(p.color[0]), g = L::all(p.color[1]), b = L::all(p.color[2]);
            [[maybe_unused]] const V z = L::all(p.depth);
            V s_q{}, s_qu{}, s_quu{}, s_qv{}, s_quv{}, s_qvv{}, s_red{}, s_green{}, s_blue{}, s_depth{};
            for (int w = 0; w < BlockSet<T>::WORDS; w++)
                for (std::uint64_t remaining = touched.word[w] & active.word[w]; remaining != 0;
                     remaining &= remaining - 1) {
                    const int i = __builtin_ctzll(remaining) + 64 * w;
                    V u, v, log2_alpha = shape.log2_alpha(grid, i, u, v);
                    BackwardPixel<T, USED>& pixel = pixels[i];
                    V transmittance = pixel.transmittance;
                    M hit = L::both(L::ge(log2_alpha, alpha_min_log2), L::gt(transmittance, V{}));
                    V raw = L::exp2(log2_alpha);
                    V alpha = L::keep(hit, L::min(raw, alpha_max));
                    V weight = alpha * transmittance;
                    V next_transmittance = transmittance - weight;
                    M finishes = L::both(hit, L::le(next_transmittance, transmittance_min));
                    if (__builtin_expect(L::any(finishes), 0)) {
                        weight = L::clear(finishes, weight);
                        alpha = L::clear(finishes, alpha);
                        next_transmittance = L::select(finishes, -transmittance, next_transmittance);
                        if (!L::any(L::gt(next_transmittance, V{}))) active.word[w] &= ~(std::uint64_t(1) << (i % 64));
                    }
                    pixel.transmittance = next_transmittance;
                    const V gr = pixel.red, gg = pixel.green, gb = pixel.blue;
                    V product = r * gr + g * gg + b * gb;
                    if constexpr (USED >= IMAGE_ALPHA) product += pixel.alpha;
                    if constexpr (USED == IMAGE_ALPHA_DEPTH) product += (z - pixel.rendered_depth) * pixel.depth;
                    V here = weight * product;
                    V rest = pixel.behind - here;
                    pixel.behind = rest;
                    V q = here - rest * alpha / (T(1) - alpha);
                    // No gradient where alpha is clamped to alpha_max.
                    q = L::keep(L::both(L::le(raw, alpha_max), hit), q);
                    V qu = q * u, qv = q * v;
                    if constexpr (NEEDED == EVERYTHING) s_q += q;
                    s_qu += qu;
                    s_qv += qv;
                    s_quu += qu * u;
                    s_quv += qu * v;
                    s_qvv += qv * v;
                    if constexpr (NEEDED == EVERYTHING) {
                        s_red += weight * gr;
                        s_green += weight * gg;
                        s_blue += weight * gb;
                    }
                    if constexpr (USED == IMAGE_ALPHA_DEPTH) s_depth += weight * pixel.depth;
                }
            Vec<T> sums[8] = {L::eight(s_q),   L::eight(s_qu),  L::eight(s_quu), L::eight(s_qv),
                              L::eight(s_quv), L::eight(s_qvv), L::eight(s_red), L::eight(s_green)};
            transpose(sums);
            store<T>(slot, ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])));
            slot[S_BLUE] = NEEDED == EVERYTHING ? sum<T>(L::eight(s_blue)) : T(0);
            slot[S_DEPTH] = USED == IMAGE_ALPHA_DEPTH ? sum<T>(L::eight(s_depth)) : T(0);
        }
    }
}

// Adds up the slots of eight splats and propagates the sums through the projection to the attributes.
template <typename T>
VS_INLINE void backward_lanes(const Splats<T>& splats, const Frame<T>& frame, const Gradients<T>& grad, const T* slots,
                              std::int64_t first, int valid) {
    using V = Vec<T>;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    const int floats = 3 * splats.coefficients;
    T lanes[SLOT][LANES] = {}, cholesky[3][LANES] = {}, unclamped[3][LANES] = {};
    bool any_drawn = false;
    for (int i = 0; i < valid; i++) {
        const Projected<T>& p = projected[first + i];
        if (!p.visible || p.left > p.right) continue;
        any_drawn = true;
        cholesky[0][i] = p.a, cholesky[1][i] = p.b, cholesky[2][i] = p.c;
        for (int k = 0; k < 3; k++) unclamped[k][i] = p.clamped >> k & 1 ? T(0) : T(1);
        const std::size_t tiles =
            std::size_t(p.right / TILE - p.left / TILE + 1) * std::size_t(p.bottom / TILE - p.top / TILE + 1);
        const T* slot = slots + SLOT * std::size_t(p.slot);
        T total[SLOT];
        for (int k = 0; k < SLOT; k++) total[k] = slot[k];
        for (std::size_t n = 1; n < tiles; n++)
            for (int k = 0; k < SLOT; k++) total[k] += slot[n * SLOT + k];
        for (int k = 0; k < SLOT; k++) lanes[k][i] = total[k];
    }
    if (!any_drawn) {
        const auto clear = [&](T* gradient, int width) {
            if (gradient == nullptr) return;
            for (int i = 0; i < width * valid; i++) gradient[width * first + i] = 0;
        };
        clear(grad.d_means, 3);
        clear(grad.d_quats, 4);
        clear(grad.d_log_scales, 3);
        clear(grad.d_logits, 1);
        clear(grad.d_sh, floats);
        clear(grad.d_offsets, 2);
        return;
    }
    prefetch_ahead<T>(splats.sh, floats, first, splats.count);
    ProjectionLanes<T> g;
    project_lanes<T>(splats, camera, first, g);
    const Mask<T> drawn = load<T>(cholesky[2]) > T(0);
    const V a = load<T>(cholesky[0]), b = load<T>(cholesky[1]), c = load<T>(cholesky[2]);
    const V q = load<T>(lanes[S_Q]), qu = load<T>(lanes[S_QU]), quu = load<T>(lanes[S_QUU]), qv = load<T>(lanes[S_QV]),
            quv = load<T>(lanes[S_QUV]), qvv = load<T>(lanes[S_QVV]);

    // L is the Cholesky factor of the conic: (a, b, c) without the scale for base 2. The gradient of the 2D mean is
    // L^T (qu, qv). That of F (rows u and v, 2D covariance F F^T) is L^T Q (L F), with Q = (quu quv; quv qvv).
    const T root = T(1.1774100225154747), k = root * root;  // k = 2 ln 2 undoes the scale for base 2
    const V l_a = root * a, l_b = root * b, l_c = root * c;
    const V d_x = root * l_a * qu, d_y = root * (l_b * qu + l_c * qv);
    V d_logit = zero_unless<T>(drawn, g.one_minus_opacity * q);

    // color
    V d_color[3], basis[16], bx[16], by[16], bz[16], sh[48];
    for (int ch = 0; ch < 3; ch++) d_color[ch] = load<T>(lanes[S_RED + ch]) * load<T>(unclamped[ch]);
    sh_basis<T, true>(splats.coefficients, g.direction[0], g.direction[1], g.direction[2], basis, bx, by, bz);
    V d_dir[3] = {V{}, V{}, V{}};
    if (splats.coefficients > 1) {
        gather_long<T>(splats.sh, floats, first, splats.count, sh);
        for (int j = 1; j < splats.coefficients; j++) {
            V d_basis = sh[3 * j] * d_color[0] + sh[3 * j + 1] * d_color[1] + sh[3 * j + 2] * d_color[2];
            d_dir[0] += bx[j] * d_basis;
            d_dir[1] += by[j] * d_basis;
            d_dir[2] += bz[j] * d_basis;
        }
    }
    if (grad.d_sh != nullptr) {
        for (int j = 0; j < splats.coefficients; j++) {
            V f = zero_unless<T>(drawn, basis[j]);
            for (int ch = 0; ch < 3; ch++) sh[3 * j + ch] = f * d_color[ch];
        }
        scatter_long<T>(grad.d_sh, floats, first, valid, sh);
    }

    // Columns of L F, divided by the scales: (col_u, col_v). They come from the cross product of the rows of F, because
    // l_a u + l_b v cancels for needle-shaped splats.
    V col_u[3], col_v[3];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        V cross_term = g.v[j] * g.scale[j] * g.m_cross[l] - g.v[l] * g.scale[l] * g.m_cross[j];
        col_u[i] = l_a / g.yy * (cross_term + T(camera.dilation) * g.m_u[i]);
        col_v[i] = l_c * g.m_v[i];
    }
    V q_col_u[3], q_col_v[3];  // Q (col_u, col_v)
    for (int i = 0; i < 3; i++) {
        q_col_u[i] = k * (quu * col_u[i] + quv * col_v[i]);
        q_col_v[i] = k * (quv * col_u[i] + qvv * col_v[i]);
    }
    V variance[3], d_log_scale[3];
    for (int i = 0; i < 3; i++) {
        variance[i] = g.scale[i] * g.scale[i];
        d_log_scale[i] = zero_unless<T>(drawn, variance[i] * (q_col_u[i] * col_u[i] + q_col_v[i] * col_v[i]));
    }
    // A rotation about the splat's own axis l mixes columns i and j.
    V d_angle[3];
    for (int l = 0; l < 3; l++) {
        const int i = (l + 1) % 3, j = (l + 2) % 3;
        d_angle[l] =
            T(2) * (q_col_u[i] * col_u[j] + q_col_v[i] * col_v[j]) * (variance[i] - variance[j]) / g.quat_length;
    }
    const V* n = g.quat;
    V d_quat[4] = {-n[1] * d_angle[0] - n[2] * d_angle[1] - n[3] * d_angle[2],
                   n[0] * d_angle[0] - n[3] * d_angle[1] + n[2] * d_angle[2],
                   n[3] * d_angle[0] + n[0] * d_angle[1] - n[1] * d_angle[2],
                   -n[2] * d_angle[0] + n[1] * d_angle[1] + n[0] * d_angle[2]};
    for (int j = 0; j < 4; j++) d_quat[j] = zero_unless<T>(drawn, d_quat[j]);

    // plane_u = fx / z (w0 - x_lim w2), plane_v = fy / z (w1 - y_lim w2)
    T w[9];
    for (int i = 0; i < 9; i++) w[i] = T(camera.rotation[i]);
    const T fx = T(camera.fx), fy = T(camera.fy);
    V pu_w2{}, pv_w2{};
    for (int i = 0; i < 3; i++) {
        V along = variance[i] * (w[6] * g.rotation[i] + w[7] * g.rotation[3 + i] + w[8] * g.rotation[6 + i]);
        pu_w2 += along * (l_a * q_col_u[i]);
        pv_w2 += along * (l_b * q_col_u[i] + l_c * q_col_v[i]);
    }
    // 1 / z scales all of F, like the three scales together
    V d_inverse = (d_log_scale[0] + d_log_scale[1] + d_log_scale[2]) * g.depth;
    Mask<T> unclamped_x = (g.x_z >= T(camera.limits[0])) & (g.x_z <= T(camera.limits[1]));
    Mask<T> unclamped_y = (g.y_z >= T(camera.limits[2])) & (g.y_z <= T(camera.limits[3]));
    V d_x_z = fx * d_x - zero_unless<T>(unclamped_x, fx * g.inverse_depth * pu_w2);
    V d_y_z = fy * d_y - zero_unless<T>(unclamped_y, fy * g.inverse_depth * pv_w2);
    V local_x = d_x_z * g.inverse_depth, local_y = d_y_z * g.inverse_depth;
    // x_z = x / z
    V local_z =
        load<T>(lanes[S_DEPTH]) - g.inverse_depth * (g.inverse_depth * d_inverse + g.x_z * d_x_z + g.y_z * d_y_z);

    V radial = g.direction[0] * d_dir[0] + g.direction[1] * d_dir[1] + g.direction[2] * d_dir[2];
    V inverse_distance = T(1) / vmax<T>(g.distance, broadcast<T>(T(1e-12))), d_mean[3];
    for (int j = 0; j < 3; j++)
        d_mean[j] = zero_unless<T>(drawn, w[j] * local_x + w[3 + j] * local_y + w[6 + j] * local_z +
                                              (d_dir[j] - g.direction[j] * radial) * inverse_distance);

    if (grad.d_means != nullptr) scatter<T>(grad.d_means, 3, first, valid, d_mean);
    if (grad.d_quats != nullptr) scatter<T>(grad.d_quats, 4, first, valid, d_quat);
    if (grad.d_log_scales != nullptr) scatter<T>(grad.d_log_scales, 3, first, valid, d_log_scale);
    if (grad.d_logits != nullptr) scatter<T>(grad.d_logits, 1, first, valid, &d_logit);
    if (grad.d_offsets != nullptr) {
        V d_offset[2] = {zero_unless<T>(drawn, d_x), zero_unless<T>(drawn, d_y)};
        scatter<T>(grad.d_offsets, 2, first, valid, d_offset);
    }
}

}  // namespace vs::VS_ISA
