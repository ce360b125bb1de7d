// Backward pass: over one tile, then splat by splat. Included by isa.h, once for each instruction set.

// Sums over the pixels of a tile that a splat's slot holds. q is dLoss/d(ln alpha).
enum Slot { S_Q, S_QU, S_QUU, S_QV, S_QUV, S_QVV, S_RED, S_GREEN, S_BLUE, S_DEPTH };

// Pass D for one tile. With S the sum of what lies behind a splat at a pixel (color times gradient), blended,
// dLoss/dalpha = T (color . g) - S / (1 - alpha); S starts as the whole pixel and shrinks front to back.
template <typename T, bool EXTRA>
struct BackwardPixel {
    Vec<T> transmittance, behind, red, green, blue;  // the colors are gradients
};
template <typename T>
struct BackwardPixel<T, true> {
    Vec<T> transmittance, behind, red, green, blue, alpha, depth, mean_depth;
};

template <typename T, bool EXTRA>
static void backward_tile(const Frame<T>& frame, const TileBox& box, const Intersection<T>* list, std::uint32_t count,
                          const Gradients<T>& grad, T* slots, int tile) {
    using V = Vec<T>;
    using M = Mask<T>;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    BackwardPixel<T, EXTRA> pixels[BLOCKS];
    Grid<T> grid;
    Grid<T>::fill(grid);
    Blocks alive = clear_tile<T>(box, grid, pixels);
    if (box.width < TILE || box.height < TILE)
        for (BackwardPixel<T, EXTRA>& at : pixels) {
            at.behind = at.red = at.green = at.blue = V{};
            if constexpr (EXTRA) at.alpha = at.depth = at.mean_depth = V{};
        }
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H) * BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H * BLOCK_W + x % BLOCK_W;
            const std::int64_t here = row + x;
            BackwardPixel<T, EXTRA>& at = pixels[i];
            T gr = 0, gg = 0, gb = 0;
            if (grad.d_image != nullptr)
                gr = grad.d_image[3 * here], gg = grad.d_image[3 * here + 1], gb = grad.d_image[3 * here + 2];
            at.red[lane] = gr, at.green[lane] = gg, at.blue[lane] = gb;
            T rest = grad.image[3 * here] * gr + grad.image[3 * here + 1] * gg + grad.image[3 * here + 2] * gb;
            if constexpr (EXTRA) {
                // depth = sum(w z) / sum(w): the weight w of a splat at z is worth (z - depth) / sum(w)
                const T alpha = grad.alpha[here], ga = grad.d_alpha != nullptr ? grad.d_alpha[here] : T(0);
                at.alpha[lane] = ga;
                at.depth[lane] = grad.d_depth != nullptr && alpha > 0 ? grad.d_depth[here] / alpha : T(0);
                at.mean_depth[lane] = grad.depth[here];
                rest += alpha * ga;
            }
            at.behind[lane] = rest;
        }
    }
    const V cut = broadcast<T>(T(ALPHA_MIN_LOG2)), alpha_max = broadcast<T>(T(camera.alpha_max)),
            least = broadcast<T>(T(TRANSMITTANCE_MIN));
    const int tile_x = tile % frame.tiles_x, tile_y = tile / frame.tiles_x;
    auto slot_of = [&](const Projected<T>& p) {
        const int across = p.right / TILE - p.left / TILE + 1;
        return slots +
               SLOT * (std::size_t(p.slot) + std::size_t((tile_y - p.top / TILE) * across + tile_x - p.left / TILE));
    };
    Batch<T> batch;
    for (std::uint32_t n = 0; n < count;) {
        const std::uint32_t start = n;
        n = batch.fill(projected, list, n, count, box, alive);
        // Slots of splats that reach nothing here any more stay empty.
        for (std::uint32_t k = start; k < n; k++) {
            T* slot = slot_of(projected[list[k].splat]);
            for (int i = 0; i < SLOT; i++) slot[i] = 0;
        }
        for (int k = 0; k < batch.size; k++) {
            const Projected<T>& p = *batch.splats[k];
            const Blocks reach = batch.reach[k];
            T* slot = slot_of(p);
            const Shape<T> shape = Shape<T>::of(p, box);
            const V r = broadcast<T>(p.color[0]), g = broadcast<T>(p.color[1]), b = broadcast<T>(p.color[2]), z = broadcast<T>(p.depth);
            V s_q{}, s_qu{}, s_quu{}, s_qv{}, s_quv{}, s_qvv{}, s_red{}, s_green{}, s_blue{}, s_depth{};
            for (int h = 0; h < 2; h++)
                for (std::uint64_t left = reach.half[h] & alive.half[h]; left != 0; left &= left - 1) {
                    const int i = __builtin_ctzll(left) + 64 * h;
                    V u, v, e = shape.exponent(grid, i, u, v);
                    BackwardPixel<T, EXTRA>& at = pixels[i];
                    V before = at.transmittance;
                    M hit = ge<T>(e, cut) & gt<T>(before, V{});
                    V raw = vexp2(e);
                    V alpha = zero_unless<T>(hit, vmin<T>(raw, alpha_max));
                    V weight = alpha * before;
                    V after = before - weight;
                    M stop = hit & le<T>(after, least);
                    if (__builtin_expect(any(stop), 0)) {
                        weight = zero_unless<T>(~stop, weight);
                        alpha = zero_unless<T>(~stop, alpha);
                        after = select<T>(stop, -before, after);
                        if (!any(gt<T>(after, V{}))) alive.half[h] &= ~(std::uint64_t(1) << (i % 64));
                    }
                    at.transmittance = after;
                    const V gr = at.red, gg = at.green, gb = at.blue;
                    V product = r * gr + g * gg + b * gb;
                    if constexpr (EXTRA) product += at.alpha + (z - at.mean_depth) * at.depth;
                    V here = weight * product;
                    V rest = at.behind - here;
                    at.behind = rest;
                    V q = here - rest * alpha / (T(1) - alpha);
                    // Where alpha is at its upper clamp, it does not follow the splat.
                    q = zero_unless<T>(le<T>(raw, alpha_max) & hit, q);
                    V qu = q * u, qv = q * v;
                    s_q += q;
                    s_qu += qu;
                    s_qv += qv;
                    s_quu += qu * u;
                    s_quv += qu * v;
                    s_qvv += qv * v;
                    s_red += weight * gr;
                    s_green += weight * gg;
                    s_blue += weight * gb;
                    if constexpr (EXTRA) s_depth += weight * at.depth;
                }
            V sums[8] = {s_q, s_qu, s_quu, s_qv, s_quv, s_qvv, s_red, s_green};
            transpose(sums);
            store<T>(slot, ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])));
            slot[S_BLUE] = sum<T>(s_blue);
            slot[S_DEPTH] = EXTRA ? sum<T>(s_depth) : T(0);
        }
    }
}

// Pass E for eight splats: from the sums over pixels to the attributes.
template <typename T>
VS_INLINE void backward_group(const Splats<T>& splats, const Frame<T>& frame, const Gradients<T>& grad, const T* slots,
                              std::int64_t first, int valid) {
    using V = Vec<T>;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    const int floats = 3 * splats.coefficients;
    T lanes[SLOT][LANES] = {}, factor[3][LANES] = {}, open[3][LANES] = {};
    bool some = false;
    for (int i = 0; i < valid; i++) {
        const Projected<T>& p = projected[first + i];
        if (!p.visible || p.left > p.right) continue;
        some = true;
        factor[0][i] = p.a, factor[1][i] = p.b, factor[2][i] = p.c;
        for (int k = 0; k < 3; k++) open[k][i] = p.clamped >> k & 1 ? T(0) : T(1);
        const std::size_t tiles =
            std::size_t(p.right / TILE - p.left / TILE + 1) * std::size_t(p.bottom / TILE - p.top / TILE + 1);
        const T* slot = slots + SLOT * std::size_t(p.slot);
        T total[SLOT];
        for (int k = 0; k < SLOT; k++) total[k] = slot[k];
        for (std::size_t n = 1; n < tiles; n++)
            for (int k = 0; k < SLOT; k++) total[k] += slot[n * SLOT + k];
        for (int k = 0; k < SLOT; k++) lanes[k][i] = total[k];
    }
    if (!some) {
        for (int i = 0; i < 3 * valid; i++) grad.d_means[3 * first + i] = grad.d_log_scales[3 * first + i] = 0;
        for (int i = 0; i < 4 * valid; i++) grad.d_quats[4 * first + i] = 0;
        for (int i = 0; i < valid; i++) grad.d_logits[first + i] = 0;
        for (int i = 0; i < floats * valid; i++) grad.d_sh[floats * first + i] = 0;
        if (grad.d_offsets != nullptr)
            for (int i = 0; i < 2 * valid; i++) grad.d_offsets[2 * first + i] = 0;
        return;
    }
    prefetch_ahead<T>(splats.sh, floats, first, splats.count);
    Group<T> g;
    project_group<T>(splats, camera, first, g);
    const Mask<T> drawn = gt<T>(load<T>(factor[2]), V{});
    const V a = load<T>(factor[0]), b = load<T>(factor[1]), c = load<T>(factor[2]);
    const V q = load<T>(lanes[S_Q]), qu = load<T>(lanes[S_QU]), quu = load<T>(lanes[S_QUU]), qv = load<T>(lanes[S_QV]),
            quv = load<T>(lanes[S_QUV]), qvv = load<T>(lanes[S_QVV]);

    // With L the Cholesky factor of the inverse covariance (a, b, c without their scale), the gradient of the mean is
    // L^T (qu, qv), and that of the covariance's factor F (rows u and v) is L^T Q (L F), with Q = (quu quv; quv qvv).
    const T root = T(1.1774100225154747), k = root * root;  // k = 2 ln 2 undoes the scale for base 2
    const V l_a = root * a, l_b = root * b, l_c = root * c;
    const V d_x = root * l_a * qu, d_y = root * (l_b * qu + l_c * qv);
    V d_logit = zero_unless<T>(drawn, g.one_minus_opacity * q);

    // color
    V d_color[3], basis[16], bx[16], by[16], bz[16], sh[48];
    for (int ch = 0; ch < 3; ch++) d_color[ch] = load<T>(lanes[S_RED + ch]) * load<T>(open[ch]);
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
    for (int j = 0; j < splats.coefficients; j++) {
        V f = zero_unless<T>(drawn, basis[j]);
        for (int ch = 0; ch < 3; ch++) sh[3 * j + ch] = f * d_color[ch];
    }
    scatter_long<T>(grad.d_sh, floats, first, valid, sh);

    // Columns of L F, divided by the scales: (e, f). Each is formed from the cross product of F's rows, since
    // l_a u + l_b v cancels out for needles.
    V e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        V bent = g.v[j] * g.scale[j] * g.m_cross[l] - g.v[l] * g.scale[l] * g.m_cross[j];
        e[i] = l_a / g.yy * (bent + T(DILATION) * g.m_u[i]);
        f[i] = l_c * g.m_v[i];
    }
    V e_q[3], f_q[3];  // Q (e, f)
    for (int i = 0; i < 3; i++) {
        e_q[i] = k * (quu * e[i] + quv * f[i]);
        f_q[i] = k * (quv * e[i] + qvv * f[i]);
    }
    V square[3], d_log_scale[3];
    for (int i = 0; i < 3; i++) {
        square[i] = g.scale[i] * g.scale[i];
        d_log_scale[i] = zero_unless<T>(drawn, square[i] * (e_q[i] * e[i] + f_q[i] * f[i]));
    }
    // A turn about the splat's own axis l mixes the columns i and j.
    V turn[3];
    for (int l = 0; l < 3; l++) {
        const int i = (l + 1) % 3, j = (l + 2) % 3;
        turn[l] = T(2) * (e_q[i] * e[j] + f_q[i] * f[j]) * (square[i] - square[j]) / g.quat_length;
    }
    const V* n = g.quat;
    V d_quat[4] = {-n[1] * turn[0] - n[2] * turn[1] - n[3] * turn[2], n[0] * turn[0] - n[3] * turn[1] + n[2] * turn[2],
                   n[3] * turn[0] + n[0] * turn[1] - n[1] * turn[2], -n[2] * turn[0] + n[1] * turn[1] + n[0] * turn[2]};
    for (int j = 0; j < 4; j++) d_quat[j] = zero_unless<T>(drawn, d_quat[j]);

    // plane_u = fx / z (w0 - x_lim w2), plane_v = fy / z (w1 - y_lim w2)
    T w[9];
    for (int i = 0; i < 9; i++) w[i] = T(camera.rotation[i]);
    const T fx = T(camera.fx), fy = T(camera.fy);
    V pu_w2{}, pv_w2{};
    for (int i = 0; i < 3; i++) {
        V along = square[i] * (w[6] * g.rotation[i] + w[7] * g.rotation[3 + i] + w[8] * g.rotation[6 + i]);
        pu_w2 += along * (l_a * e_q[i]);
        pv_w2 += along * (l_b * e_q[i] + l_c * f_q[i]);
    }
    // 1 / z scales all of F, as the three scales together do
    V d_inverse = (d_log_scale[0] + d_log_scale[1] + d_log_scale[2]) * g.depth;
    Mask<T> free_x = ge<T>(g.x_z, broadcast<T>(T(camera.limits[0]))) & le<T>(g.x_z, broadcast<T>(T(camera.limits[1])));
    Mask<T> free_y = ge<T>(g.y_z, broadcast<T>(T(camera.limits[2]))) & le<T>(g.y_z, broadcast<T>(T(camera.limits[3])));
    V d_x_z = fx * d_x - zero_unless<T>(free_x, fx * g.inverse_depth * pu_w2);
    V d_y_z = fy * d_y - zero_unless<T>(free_y, fy * g.inverse_depth * pv_w2);
    V local_x = d_x_z * g.inverse_depth, local_y = d_y_z * g.inverse_depth;
    // x_z = x / z
    V local_z =
        load<T>(lanes[S_DEPTH]) - g.inverse_depth * (g.inverse_depth * d_inverse + g.x_z * d_x_z + g.y_z * d_y_z);

    V inward = g.direction[0] * d_dir[0] + g.direction[1] * d_dir[1] + g.direction[2] * d_dir[2];
    V inverse_distance = T(1) / vmax<T>(g.distance, broadcast<T>(T(1e-12))), d_mean[3];
    for (int j = 0; j < 3; j++)
        d_mean[j] = zero_unless<T>(drawn, w[j] * local_x + w[3 + j] * local_y + w[6 + j] * local_z +
                                       (d_dir[j] - g.direction[j] * inward) * inverse_distance);

    scatter<T>(grad.d_means, 3, first, valid, d_mean);
    scatter<T>(grad.d_quats, 4, first, valid, d_quat);
    scatter<T>(grad.d_log_scales, 3, first, valid, d_log_scale);
    scatter<T>(grad.d_logits, 1, first, valid, &d_logit);
    if (grad.d_offsets != nullptr) {
        V d_offset[2] = {zero_unless<T>(drawn, d_x), zero_unless<T>(drawn, d_y)};
        scatter<T>(grad.d_offsets, 2, first, valid, d_offset);
    }
}
