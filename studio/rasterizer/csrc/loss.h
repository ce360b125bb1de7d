// (1 - w) L1 + w (1 - SSIM) and its gradient in one sweep over the image. Included by isa.h, once for each instruction
// set. SSIM is studio.metrics.ssim: 11x11 Gaussian window, sigma 1.5, zeros outside the image.
//
// Rows go through two rings of eleven: blurred along the row (x, y, x^2 + y^2, x y), then, from the finished sums, the
// partial derivatives by those four means, blurred along the row again. The columns of both rings give SSIM and the
// gradient. RGB stays interleaved: a neighbor is three floats away.

constexpr int TAPS = 11, HALF = 5, REACH = 3 * HALF;

struct LossWeights {
    float tap[HALF + 1];  // the center first
};

// out[i] = sum_k tap_k in[i + 3 k], `in` with REACH floats to spare on both sides
VS_INLINE void blur_row(const LossWeights& w, const float* in, float* out, int count) {
    for (int i = 0; i < count; i += LANES) {
        VFloat s = w.tap[0] * load<float>(in + i);
        for (int k = 1; k <= HALF; k++) s += w.tap[k] * (load<float>(in + i - 3 * k) + load<float>(in + i + 3 * k));
        store<float>(out + i, s);
    }
}

VS_INLINE VFloat blur_column(const LossWeights& w, float* const* ring, int i) {
    VFloat s = w.tap[0] * load<float>(ring[HALF] + i);
    for (int k = 1; k <= HALF; k++) s += w.tap[k] * (load<float>(ring[HALF - k] + i) + load<float>(ring[HALF + k] + i));
    return s;
}

static void loss_band(const LossJob& job, const LossWeights& w, int begin, int end, float* scratch, double* row_l1,
                      double* row_ssim) {
    const int floats = 3 * job.width, wide = (floats + LANES - 1) / LANES * LANES, padded = wide + 2 * REACH + 2;
    const float c1 = 0.01f * 0.01f, c2 = 0.03f * 0.03f, n = float(floats) * float(job.height);
    const float l1_scale = float(1 - job.dssim_weight) / n, ssim_scale = float(-job.dssim_weight) / n;
    float* x_row = scratch + REACH;
    float* y_row = x_row + padded;
    float* part[3];
    for (int k = 0; k < 3; k++) part[k] = y_row + (k + 1) * padded;
    float* first = scratch + 5 * padded;      // [4][TAPS][wide]
    float* second = first + 4 * TAPS * wide;  // [3][TAPS][wide]
    auto slot = [](int row) { return (row + 4 * TAPS) % TAPS; };
    for (int i = 0; i < 5 * padded; i++) scratch[i] = 0;

    for (int r = begin - 2 * HALF; r < end + 2 * HALF; r++) {
        // along row r
        float* blurred[4];
        for (int k = 0; k < 4; k++) blurred[k] = first + (k * TAPS + slot(r)) * wide;
        if (r < 0 || r >= job.height) {
            for (int k = 0; k < 4; k++) __builtin_memset(blurred[k], 0, sizeof(float) * wide);
        } else {
            __builtin_memcpy(x_row, job.image + std::size_t(r) * floats, sizeof(float) * floats);
            __builtin_memcpy(y_row, job.target + std::size_t(r) * floats, sizeof(float) * floats);
            for (int i = 0; i < wide; i += LANES) {
                VFloat x = load<float>(x_row + i), y = load<float>(y_row + i);
                VFloat sx = w.tap[0] * x, sy = w.tap[0] * y, ss = w.tap[0] * (x * x + y * y), sp = w.tap[0] * (x * y);
                for (int k = 1; k <= HALF; k++) {
                    VFloat xl = load<float>(x_row + i - 3 * k), xr = load<float>(x_row + i + 3 * k);
                    VFloat yl = load<float>(y_row + i - 3 * k), yr = load<float>(y_row + i + 3 * k);
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
        float* again[3];
        for (int k = 0; k < 3; k++) again[k] = second + (k * TAPS + slot(m)) * wide;
        if (m < 0 || m >= job.height) {
            for (int k = 0; k < 3; k++) __builtin_memset(again[k], 0, sizeof(float) * wide);
        } else {
            float* ring[4][TAPS];
            for (int k = 0; k < 4; k++)
                for (int j = 0; j < TAPS; j++) ring[k][j] = first + (k * TAPS + slot(m - HALF + j)) * wide;
            double total = 0;
            for (int i = 0; i < wide; i += LANES) {
                VFloat mx = blur_column(w, ring[0], i), my = blur_column(w, ring[1], i);
                VFloat squares = blur_column(w, ring[2], i), product = blur_column(w, ring[3], i);
                VFloat mm = mx * my, mxx_myy = mx * mx + my * my;
                VFloat a1 = 2.0f * mm + c1, a2 = 2.0f * (product - mm) + c2;
                VFloat b1 = mxx_myy + c1, b2 = squares - mxx_myy + c2;
                VFloat ib1 = 1.0f / b1, ib2 = 1.0f / b2, ib = ib1 * ib2;
                VFloat ssim = a1 * a2 * ib;
                if (i + LANES > floats) {  // lanes beyond the row's end count nothing
                    for (int j = 0; j < LANES; j++)
                        if (i + j >= floats) ssim[j] = mx[j] = my[j] = ib[j] = ib1[j] = ib2[j] = 0;
                }
                total += double(sum<float>(ssim));
                if (job.gradient != nullptr) {
                    store<float>(part[0] + i, 2.0f * (my * (a2 - a1) * ib - mx * ssim * (ib1 - ib2)));
                    store<float>(part[1] + i, -ssim * ib2);
                    store<float>(part[2] + i, 2.0f * a1 * ib);
                }
            }
            if (m >= begin && m < end) row_ssim[m] = total;
            if (job.gradient != nullptr)
                for (int k = 0; k < 3; k++) blur_row(w, part[k], again[k], wide);
        }

        // the gradient at row o
        const int o = m - HALF;
        if (o < begin || o >= end) continue;
        float* ring[3][TAPS];
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < TAPS; j++) ring[k][j] = second + (k * TAPS + slot(o - HALF + j)) * wide;
        const float *xs = job.image + std::size_t(o) * floats, *ys = job.target + std::size_t(o) * floats;
        double total = 0;
        for (int i = 0; i < wide; i += LANES) {
            VFloat x{}, y{};
            const int here = floats - i < LANES ? floats - i : LANES;
            if (here == LANES)
                x = load<float>(xs + i), y = load<float>(ys + i);
            else
                for (int j = 0; j < here; j++) x[j] = xs[i + j], y[j] = ys[i + j];
            VFloat difference = x - y;
            VFloat size = difference < 0.0f ? -difference : difference;
            total += double(sum<float>(size));
            if (job.gradient == nullptr) continue;
            const VFloat zero{};
            VFloat sign = difference > zero ? broadcast<float>(l1_scale) : (difference < zero ? broadcast<float>(-l1_scale) : zero);
            VFloat g =
                blur_column(w, ring[0], i) + 2.0f * x * blur_column(w, ring[1], i) + y * blur_column(w, ring[2], i);
            g = sign + ssim_scale * g;
            float* out = job.gradient + std::size_t(o) * floats + i;
            if (here == LANES)
                store<float>(out, g);
            else
                for (int j = 0; j < here; j++) out[j] = g[j];
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

    // Each band repeats twenty rows of its neighbors, so there are as few bands as keep all threads busy.
    int bands = threads > 1 ? 2 * threads : 1;
    if (bands > job.height / 32 + 1) bands = job.height / 32 + 1;
    const int wide = (3 * job.width + LANES - 1) / LANES * LANES, padded = wide + 2 * REACH + 2;
    const std::size_t each = std::size_t(5 * padded + 7 * TAPS * wide + LANES);
    Buffer<float> scratch(each * bands);
    Buffer<double> rows(2 * std::size_t(job.height));
    double *row_l1 = rows.get(), *row_ssim = rows.get() + job.height;
    auto band = [&](int b) {
        loss_band(job, w, int(std::int64_t(job.height) * b / bands), int(std::int64_t(job.height) * (b + 1) / bands),
                  scratch.get() + each * b, row_l1, row_ssim);
    };
    parallel(bands, threads, band);
    job.l1 = job.ssim = 0;
    for (int r = 0; r < job.height; r++) job.l1 += row_l1[r], job.ssim += row_ssim[r];
    const double n = 3.0 * job.width * job.height;
    job.l1 /= n;
    job.ssim /= n;
}
