// EWA projection of splats to the image.
#pragma once

#include <cstdint>

#include "attributes.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "simd.h"

namespace vs::VS_ISA {

// Intermediate values of the projection of eight splats. The backward pass recomputes them.
template <typename T>
struct ProjectionLanes {
    using V = Vec<T>;
    V mean[3], x_z, y_z, x_lim, y_lim, depth, inverse_depth;
    V quat[4], quat_length;  // quat is normalized; quat_length is the norm before
    V rotation[9], scale[3];
    V plane_u[3], plane_v[3];      // rows of Jacobian * world_to_camera rotation
    V m_u[3], m_v[3], m_cross[3];  // the same times the splat's rotation, and their cross product
    V u[3], v[3];                  // the same times scale: rows of F, with 2D covariance F F^T
    V xx, xy, yy, det;             // dilated 2D covariance and its determinant
    V log2_opacity, one_minus_opacity;
    V direction[3], distance;
};

template <typename T>
VS_INLINE void project_lanes(const Splats<T>& splats, const Camera& camera, std::int64_t first, ProjectionLanes<T>& g) {
    using V = Vec<T>;
    V logit, log_scale[3];
    gather<T>(splats.means, 3, first, splats.count, g.mean);
    gather<T>(splats.quats, 4, first, splats.count, g.quat);
    gather<T>(splats.log_scales, 3, first, splats.count, log_scale);
    gather<T>(splats.logits, 1, first, splats.count, &logit);
    T w[9], t[3];
    for (int i = 0; i < 9; i++) w[i] = T(camera.rotation[i]);
    for (int i = 0; i < 3; i++) t[i] = T(camera.translation[i]);
    V x = w[0] * g.mean[0] + w[1] * g.mean[1] + w[2] * g.mean[2] + t[0];
    V y = w[3] * g.mean[0] + w[4] * g.mean[1] + w[5] * g.mean[2] + t[1];
    g.depth = w[6] * g.mean[0] + w[7] * g.mean[1] + w[8] * g.mean[2] + t[2];
    g.inverse_depth = T(1) / g.depth;
    g.x_z = x * g.inverse_depth;
    g.y_z = y * g.inverse_depth;
    g.x_lim = vmin<T>(vmax<T>(g.x_z, broadcast<T>(T(camera.limits[0]))), broadcast<T>(T(camera.limits[1])));
    g.y_lim = vmin<T>(vmax<T>(g.y_z, broadcast<T>(T(camera.limits[2]))), broadcast<T>(T(camera.limits[3])));

    V* q = g.quat;
    g.quat_length = vsqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    V inverse_length = T(1) / g.quat_length;
    for (int i = 0; i < 4; i++) q[i] *= inverse_length;
    V* r = g.rotation;
    r[0] = T(1) - T(2) * (q[2] * q[2] + q[3] * q[3]);
    r[1] = T(2) * (q[1] * q[2] - q[0] * q[3]);
    r[2] = T(2) * (q[1] * q[3] + q[0] * q[2]);
    r[3] = T(2) * (q[1] * q[2] + q[0] * q[3]);
    r[4] = T(1) - T(2) * (q[1] * q[1] + q[3] * q[3]);
    r[5] = T(2) * (q[2] * q[3] - q[0] * q[1]);
    r[6] = T(2) * (q[1] * q[3] - q[0] * q[2]);
    r[7] = T(2) * (q[2] * q[3] + q[0] * q[1]);
    r[8] = T(1) - T(2) * (q[1] * q[1] + q[2] * q[2]);

    T fx = T(camera.fx), fy = T(camera.fy);
    V fx_z = fx * g.inverse_depth, fy_z = fy * g.inverse_depth;
    for (int k = 0; k < 3; k++) {
        g.plane_u[k] = fx_z * (w[k] - g.x_lim * w[6 + k]);
        g.plane_v[k] = fy_z * (w[3 + k] - g.y_lim * w[6 + k]);
    }
    for (int k = 0; k < 3; k++) {
        g.scale[k] = vexp(log_scale[k]);
        g.m_u[k] = g.plane_u[0] * r[k] + g.plane_u[1] * r[3 + k] + g.plane_u[2] * r[6 + k];
        g.m_v[k] = g.plane_v[0] * r[k] + g.plane_v[1] * r[3 + k] + g.plane_v[2] * r[6 + k];
        g.u[k] = g.m_u[k] * g.scale[k];
        g.v[k] = g.m_v[k] * g.scale[k];
    }
    const T d = T(camera.dilation);
    V uu = g.u[0] * g.u[0] + g.u[1] * g.u[1] + g.u[2] * g.u[2];
    V vv = g.v[0] * g.v[0] + g.v[1] * g.v[1] + g.v[2] * g.v[2];
    g.xy = g.u[0] * g.v[0] + g.u[1] * g.v[1] + g.u[2] * g.v[2];
    g.xx = uu + d;
    g.yy = vv + d;
    // |u|^2 |v|^2 - (u.v)^2 = |u x v|^2, where u x v is the scaled viewing ray in the splat's axes. For needle-shaped
    // splats this avoids the cancellation in the difference.
    V ray[3], area = fx_z * fy_z, cross = V{};
    for (int k = 0; k < 3; k++) ray[k] = g.x_lim * w[k] + g.y_lim * w[3 + k] + w[6 + k];
    for (int k = 0; k < 3; k++) {
        g.m_cross[k] = area * (ray[0] * r[k] + ray[1] * r[3 + k] + ray[2] * r[6 + k]);
        V part = g.m_cross[k] * g.scale[(k + 1) % 3] * g.scale[(k + 2) % 3];
        cross += part * part;
    }
    g.det = cross + d * (uu + vv) + d * d;

    V t_opacity = vexp(-logit);
    g.log2_opacity = -vlog2(T(1) + t_opacity);
    g.one_minus_opacity = t_opacity / (T(1) + t_opacity);

    V offset[3];
    for (int k = 0; k < 3; k++) offset[k] = g.mean[k] - T(camera.center[k]);
    g.distance = vsqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]);
    V inverse_distance = T(1) / vmax<T>(g.distance, broadcast<T>(T(1e-12)));
    for (int k = 0; k < 3; k++) g.direction[k] = offset[k] * inverse_distance;
}

struct Range {  // of splats
    std::int64_t begin, end;
};
// Projects splats [begin, end): writes `projected` and `radii`, counts intersections per tile in `tile_counts`, and
// returns the total number of intersections.
template <typename T>
static std::uint64_t project_chunk(const Splats<T>& splats, const Camera& camera, Range range, Projected<T>* projected,
                                   T* radii, int tiles_x, int tiles_y, std::uint32_t* tile_counts) {
    using V = Vec<T>;
    using M = Mask<T>;
    const int floats = 3 * splats.coefficients;
    const T width = T(camera.width), height = T(camera.height);
    const T too_large = sizeof(T) == 4 ? T(1e30) : T(1e250);
    std::uint64_t pairs = 0;
    for (int i = 0; i < tiles_x * tiles_y; i++) tile_counts[i] = 0;
    for (std::int64_t first = range.begin; first < range.end; first += LANES) {
        const int valid = range.end - first < LANES ? int(range.end - first) : LANES;
        prefetch_ahead<T>(splats.sh, floats, first, splats.count);
        ProjectionLanes<T> g;
        project_lanes<T>(splats, camera, first, g);
        V mx = T(camera.fx) * g.x_z + T(camera.cx), my = T(camera.fy) * g.y_z + T(camera.cy);
        if (splats.offsets != nullptr) {
            V offset[2];
            gather<T>(splats.offsets, 2, first, splats.count, offset);
            mx += offset[0];
            my += offset[1];
        }
        // Distance in standard deviations at which alpha falls to 1/255; 2 ln 2 converts from base 2.
        V extent = vsqrt(vmax<T>(T(1.3862943611198906) * (g.log2_opacity - T(ALPHA_MIN_LOG2)), V{}));
        V half_x = extent * vsqrt(g.xx), half_y = extent * vsqrt(g.yy);
        // Comparisons with NaN are false, so such splats are not drawn.
        M visible = (g.depth >= T(camera.near)) & (g.depth < too_large) & (g.log2_opacity >= T(ALPHA_MIN_LOG2));
        visible &= (g.quat_length > T(0)) & (g.quat_length < too_large) & (g.det > T(0)) & (g.det < too_large);
        visible &= (mx + half_x > T(0)) & (mx - half_x < width) & (half_x < too_large);
        visible &= (my + half_y > T(0)) & (my - half_y < height) & (half_y < too_large);
        if (!any(visible)) {
            for (int i = 0; i < valid; i++) {
                projected[first + i].visible = 0;
                radii[first + i] = 0;
            }
            continue;
        }

        V basis[16], sh[48], color[3];
        sh_basis<T, false>(splats.coefficients, g.direction[0], g.direction[1], g.direction[2], basis, nullptr, nullptr,
                           nullptr);
        gather_long<T>(splats.sh, floats, first, splats.count, sh);
        for (int c = 0; c < 3; c++) {
            color[c] = broadcast<T>(T(0.5));
            for (int k = 0; k < splats.coefficients; k++) color[c] += basis[k] * sh[3 * k + c];
            visible &= (color[c] < too_large) & (color[c] > -too_large);
        }

        // u = a dx + b dy, v = c dy with u^2 + v^2 = (log2(e) / 2) d^T cov^-1 d
        const T s = T(0.84932180028801904272);
        V ratio = T(1) / vsqrt(g.yy * g.det);
        V a = s * g.yy * ratio, b = -s * g.xy * ratio, c = s / vsqrt(g.yy), slant = g.xy / g.yy;

        // Pixels whose centers are in the box, with some slack: each pixel is tested again when blending.
        V slack_x = T(1e-3) + half_x * T(1e-5), slack_y = T(1e-3) + half_y * T(1e-5);
        V low_x = vmax<T>(mx - half_x - T(0.5) - slack_x, broadcast<T>(T(-1))),
          high_x = vmin<T>(mx + half_x - T(0.5) + slack_x, broadcast<T>(width - T(1)));
        V low_y = vmax<T>(my - half_y - T(0.5) - slack_y, broadcast<T>(T(-1))),
          high_y = vmin<T>(my + half_y - T(0.5) + slack_y, broadcast<T>(height - T(1)));

        const unsigned visible_bits = movemask(visible);
        T lanes[16][LANES];
        const V fields[16] = {mx,       my,      a,     b,      c,     g.log2_opacity, color[0], color[1],
                              color[2], g.depth, low_x, high_x, low_y, high_y,         slant,    T(1) / a};
        for (int k = 0; k < 16; k++) store<T>(lanes[k], fields[k]);
        T half[LANES];
        store<T>(half, vmax<T>(half_x, half_y));
        for (int i = 0; i < valid; i++) {
            Projected<T>& p = projected[first + i];
            p.visible = visible_bits >> i & 1;
            if (!p.visible) {
                radii[first + i] = 0;
                continue;
            }
            radii[first + i] = half[i];
            p.x = lanes[0][i], p.y = lanes[1][i], p.a = lanes[2][i], p.b = lanes[3][i], p.c = lanes[4][i];
            p.log2_opacity = lanes[5][i];
            p.clamped = 0;
            for (int k = 0; k < 3; k++) {
                p.color[k] = lanes[6 + k][i] >= 0 ? lanes[6 + k][i] : T(0);
                p.clamped |= std::uint8_t(lanes[6 + k][i] < 0) << k;
            }
            p.depth = lanes[9][i], p.slant = lanes[14][i], p.width = lanes[15][i];
            // The bounds are in [-1, size - 1]; adding 2 makes truncation equal to floor.
            int left = int(lanes[10][i] + 2) - 2, top = int(lanes[12][i] + 2) - 2;
            left += T(left) < lanes[10][i];
            top += T(top) < lanes[12][i];
            if (left < 0) left = 0;
            if (top < 0) top = 0;
            int right = int(lanes[11][i] + 2) - 2, bottom = int(lanes[13][i] + 2) - 2;
            p.left = std::int16_t(left), p.top = std::int16_t(top);
            p.right = std::int16_t(right), p.bottom = std::int16_t(bottom);
            if (left > right || top > bottom) {
                p.left = 1, p.right = 0;
                continue;
            }
            int x0 = left / TILE, x1 = right / TILE, y0 = top / TILE, y1 = bottom / TILE;
            pairs += std::uint64_t(x1 - x0 + 1) * std::uint64_t(y1 - y0 + 1);
            for (int ty = y0; ty <= y1; ty++)
                for (int tx = x0; tx <= x1; tx++) tile_counts[ty * tiles_x + tx]++;
        }
    }
    return pairs;
}

}  // namespace vs::VS_ISA
