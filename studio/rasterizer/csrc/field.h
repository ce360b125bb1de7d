// The motion field, a hash grid and an MLP with ReLU, forward and backward. The definition is
// studio/training/hashgrid.py and motion.py.
//
// Forward:   encode  per level: gather the corners of the grid
//            block   per chunk of points: one small matrix product per layer
// Backward:  block  per block of points: gradients of the layers, summed over the block, and of the encoding
//            table  per level of the grid: add the gradients of the encodings to its rows, in the order of the points
// Blocks are the same for any number of threads, so the sums are too.
#pragma once

#include <cstddef>
#include <cstdint>

#include "buffers.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

// Registers hold a block of ROWS x VECTORS sums. AVX-512 has 32 registers, AVX2 has 16.
#if defined(__AVX512F__) || defined(__aarch64__)
constexpr int MAX_VECTORS = 4;
#else
constexpr int MAX_VECTORS = 2;
#endif
constexpr int FIELD_CHUNK = 48;                // points whose activations stay in the first-level cache
constexpr int FIELD_BLOCK = 32 * FIELD_CHUNK;  // points that share one sum of gradients
constexpr int FIELD_ROUND = 16;                // padding of rows of activations, values

VS_INLINE int field_padded(int width) { return (width + FIELD_ROUND - 1) / FIELD_ROUND * FIELD_ROUND; }

// C[r][n] = start[n] + sum_k A[r * row + k * step] B[k][n], or added to C. N is a multiple of the width of a vector.
template <typename T>
struct Product {
    int depth;
    const T* a;
    int a_row, a_step;
    const T* b;
    int b_row;
    T* c = nullptr;
    int c_row = 0;
    const T* start = nullptr;  // (N,), or null: zero
    bool add = false, relu = false;
};

template <typename T, int ROWS, int VECTORS>
VS_INLINE void product_block(const Product<T>& p, int row, int column) {
    using V = Wide<T>;
    constexpr int W = WIDTH<T>;
    const T* a = p.a + std::ptrdiff_t(row) * p.a_row;
    const T* b = p.b + column;
    T* c = p.c + std::ptrdiff_t(row) * p.c_row + column;
    V sums[ROWS][VECTORS];
    for (int r = 0; r < ROWS; r++)
        for (int v = 0; v < VECTORS; v++)
            sums[r][v] = p.add ? load<T, V>(c + r * p.c_row + v * W)
                               : (p.start != nullptr ? load<T, V>(p.start + column + v * W) : V{});
    for (int k = 0; k < p.depth; k++) {
        V line[VECTORS];
        for (int v = 0; v < VECTORS; v++) line[v] = load<T, V>(b + std::ptrdiff_t(k) * p.b_row + v * W);
        for (int r = 0; r < ROWS; r++) {
            const V factor = wide_all<T>(a[std::ptrdiff_t(r) * p.a_row + std::ptrdiff_t(k) * p.a_step]);
            for (int v = 0; v < VECTORS; v++) sums[r][v] += factor * line[v];
        }
    }
    for (int r = 0; r < ROWS; r++)
        for (int v = 0; v < VECTORS; v++) {
            V x = sums[r][v];
            if (p.relu) x = x < V{} ? V{} : x;  // keeps NaN
            store<T>(c + r * p.c_row + v * W, x);
        }
}

template <typename T, int VECTORS>
VS_INLINE void product_columns(const Product<T>& p, int rows, int column) {
    int row = 0;
    for (; row + 6 <= rows; row += 6) product_block<T, 6, VECTORS>(p, row, column);
    for (; row + 2 <= rows; row += 2) product_block<T, 2, VECTORS>(p, row, column);
    for (; row < rows; row++) product_block<T, 1, VECTORS>(p, row, column);
}

template <typename T>
static void product(const Product<T>& p, int rows, int columns) {
    constexpr int W = WIDTH<T>;
    int column = 0;
    for (; column + MAX_VECTORS * W <= columns; column += MAX_VECTORS * W)
        product_columns<T, MAX_VECTORS>(p, rows, column);
    for (; column + 2 * W <= columns; column += 2 * W) product_columns<T, 2>(p, rows, column);
    for (; column < columns; column += W) product_columns<T, 1>(p, rows, column);
}

// Four features, the usual number. Explicit vectors, since the compiler must assume that the table overlaps the weights.
template <typename T>
using Four = typename VectorOf<T, 4 * sizeof(T)>::V;

template <typename T>
VS_INLINE void encode_point(const T* table, const std::int32_t* rows, const T* weights, int features, T* out) {
    if (features == 4) {
        Four<T> sum{};
        for (int corner = 0; corner < 8; corner++)
            sum += weights[corner] * load<T, Four<T>>(table + std::ptrdiff_t(rows[corner]) * 4);
        return store(out, sum);
    }
    T sums[16] = {};
    for (int corner = 0; corner < 8; corner++) {
        const T* row = table + std::ptrdiff_t(rows[corner]) * features;
        for (int i = 0; i < features; i++) sums[i] += weights[corner] * row[i];
    }
    for (int i = 0; i < features; i++) out[i] = sums[i];
}

template <typename T>
VS_INLINE void spread_point(T* table, const std::int32_t* rows, const T* weights, int features, const T* gradient) {
    if (features == 4) {
        const Four<T> g = load<T, Four<T>>(gradient);
        for (int corner = 0; corner < 8; corner++) {
            T* row = table + std::ptrdiff_t(rows[corner]) * 4;
            store(row, load<T, Four<T>>(row) + weights[corner] * g);
        }
        return;
    }
    for (int corner = 0; corner < 8; corner++) {
        T* row = table + std::ptrdiff_t(rows[corner]) * features;
        for (int i = 0; i < features; i++) row[i] += weights[corner] * gradient[i];
    }
}

// Weights of a layer, transposed and padded with zeros: (padded inputs, padded outputs), then the bias.
struct FieldLayer {
    int inputs, outputs, padded_inputs, padded_outputs;
};

VS_INLINE FieldLayer field_layer(const FieldShape& shape, int layer) {
    const int inputs = layer == 0 ? shape.levels * shape.features : shape.hidden;
    const int outputs = layer == shape.layers ? 3 : shape.hidden;
    return {inputs, outputs, field_padded(inputs), field_padded(outputs)};
}

// Offset of a layer's input in the activations of one chunk, values per point.
VS_INLINE int field_offset(const FieldShape& shape, int layer) {
    return layer == 0 ? 0 : field_padded(shape.levels * shape.features) + (layer - 1) * field_padded(shape.hidden);
}

template <typename T>
static void field_forward(const FieldJob<T>& job, Buffer<T>& activations, T* out, int threads) {
    const FieldShape& shape = job.shape;
    const int per_point = field_offset(shape, shape.layers + 1), encoded = field_padded(shape.levels * shape.features);
    const std::int64_t chunks = (job.count + FIELD_CHUNK - 1) / FIELD_CHUNK;
    activations = Buffer<T>(std::size_t(chunks) * FIELD_CHUNK * std::size_t(per_point));

    Buffer<T> packed[MAX_FIELD_LAYERS + 1];
    for (int l = 0; l <= shape.layers; l++) {
        const FieldLayer layer = field_layer(shape, l);
        packed[l] = Buffer<T>(std::size_t(layer.padded_inputs + 1) * std::size_t(layer.padded_outputs));
        T* to = packed[l].get();
        for (int i = 0; i < layer.padded_inputs; i++)
            for (int o = 0; o < layer.padded_outputs; o++)
                to[i * layer.padded_outputs + o] =
                    i < layer.inputs && o < layer.outputs ? job.weights[l][o * layer.inputs + i] : T(0);
        for (int o = 0; o < layer.padded_outputs; o++)
            to[layer.padded_inputs * layer.padded_outputs + o] = o < layer.outputs ? job.biases[l][o] : T(0);
    }
    // Level by level, so that the rows of one level stay in the second-level cache.
    const std::int64_t share = (chunks + threads - 1) / threads;
    auto encode = [&](int task) {
        const std::int64_t begin = task * share, end = begin + share < chunks ? begin + share : chunks;
        for (int level = 0; level < shape.levels; level++)
            for (std::int64_t chunk = begin; chunk < end; chunk++) {
                const std::int64_t first = chunk * FIELD_CHUNK;
                const int points = job.count - first < FIELD_CHUNK ? int(job.count - first) : FIELD_CHUNK;
                T* base = activations.get() + std::size_t(first) * std::size_t(per_point);
                for (int p = 0; p < points; p++) {
                    const std::int64_t at = 8 * (std::int64_t(level) * job.count + first + p);
                    encode_point<T>(job.table, job.rows + at, job.corner_weights + at, shape.features,
                                    base + p * encoded + level * shape.features);
                }
            }
    };
    parallel_for(threads, threads, encode);

    auto block = [&](int task) {
        const std::int64_t first_chunk = std::int64_t(task) * (FIELD_BLOCK / FIELD_CHUNK);
        for (std::int64_t chunk = first_chunk; chunk < first_chunk + FIELD_BLOCK / FIELD_CHUNK && chunk < chunks;
             chunk++) {
            const std::int64_t first = chunk * FIELD_CHUNK;
            const int points = job.count - first < FIELD_CHUNK ? int(job.count - first) : FIELD_CHUNK;
            T* base = activations.get() + std::size_t(first) * std::size_t(per_point);
            for (int i = shape.levels * shape.features; i < encoded; i++)
                for (int p = 0; p < FIELD_CHUNK; p++) base[p * encoded + i] = 0;
            for (int p = points; p < FIELD_CHUNK; p++)
                for (int i = 0; i < encoded; i++) base[p * encoded + i] = 0;
            alignas(64) T last[FIELD_CHUNK * FIELD_ROUND];
            for (int l = 0; l <= shape.layers; l++) {
                const FieldLayer layer = field_layer(shape, l);
                const T* input = base + std::ptrdiff_t(FIELD_CHUNK) * field_offset(shape, l);
                T* to = l == shape.layers ? last : base + std::ptrdiff_t(FIELD_CHUNK) * field_offset(shape, l + 1);
                const T* weights = packed[l].get();
                Product<T> p{layer.inputs, input, layer.padded_inputs, 1, weights, layer.padded_outputs};
                p.c = to, p.c_row = layer.padded_outputs;
                p.start = weights + layer.padded_inputs * layer.padded_outputs, p.relu = l < shape.layers;
                product<T>(p, FIELD_CHUNK, layer.padded_outputs);
            }
            for (int p = 0; p < points; p++)
                for (int c = 0; c < 3; c++) out[3 * (first + p) + c] = job.scale * last[p * FIELD_ROUND + c];
        }
    };
    parallel_for(int((job.count + FIELD_BLOCK - 1) / FIELD_BLOCK), threads, block);
}

template <typename T>
static void field_backward(const FieldJob<T>& job, const Buffer<T>& activations, const FieldGradients<T>& grad,
                           int threads) {
    using V = Wide<T>;
    const FieldShape& shape = job.shape;
    const int per_point = field_offset(shape, shape.layers + 1), encoded = field_padded(shape.levels * shape.features);
    const int blocks = int((job.count + FIELD_BLOCK - 1) / FIELD_BLOCK);
    const int widest = encoded > field_padded(shape.hidden) ? encoded : field_padded(shape.hidden);

    // Weights as torch stores them, rows padded; and the padded gradients of each block.
    Buffer<T> packed[MAX_FIELD_LAYERS + 1];
    std::size_t offsets[MAX_FIELD_LAYERS + 2] = {0};
    for (int l = 0; l <= shape.layers; l++) {
        const FieldLayer layer = field_layer(shape, l);
        packed[l] = Buffer<T>(std::size_t(layer.outputs) * std::size_t(layer.padded_inputs));
        for (int o = 0; o < layer.outputs; o++)
            for (int i = 0; i < layer.padded_inputs; i++)
                packed[l].get()[o * layer.padded_inputs + i] =
                    i < layer.inputs ? job.weights[l][o * layer.inputs + i] : T(0);
        offsets[l + 1] = offsets[l] + std::size_t(layer.outputs) * std::size_t(layer.padded_inputs) +
                         std::size_t(layer.padded_outputs);
    }
    const std::size_t stride = (offsets[shape.layers + 1] + FIELD_ROUND - 1) / FIELD_ROUND * FIELD_ROUND;
    Buffer<T> partial(stride * std::size_t(blocks));
    Buffer<T> encoding_gradients(std::size_t(job.count) * std::size_t(shape.levels * shape.features));
    Buffer<T> scratch(std::size_t(2 * FIELD_CHUNK * widest) * std::size_t(blocks));

    auto block = [&](int task) {
        T* sums = partial.get() + stride * std::size_t(task);
        for (std::size_t i = 0; i < stride; i++) sums[i] = 0;
        T* gradient = scratch.get() + std::size_t(2 * FIELD_CHUNK * widest) * std::size_t(task);
        T* below = gradient + FIELD_CHUNK * widest;
        const std::int64_t begin = std::int64_t(task) * FIELD_BLOCK;
        for (std::int64_t first = begin; first < begin + FIELD_BLOCK && first < job.count; first += FIELD_CHUNK) {
            const int points = job.count - first < FIELD_CHUNK ? int(job.count - first) : FIELD_CHUNK;
            const T* base = activations.get() + std::size_t(first) * std::size_t(per_point);
            for (int p = 0; p < FIELD_CHUNK; p++)
                for (int c = 0; c < FIELD_ROUND; c++)
                    gradient[p * FIELD_ROUND + c] =
                        p < points && c < 3 ? job.scale * grad.d_out[3 * (first + p) + c] : T(0);
            for (int l = shape.layers; l >= 0; l--) {
                const FieldLayer layer = field_layer(shape, l);
                const T* input = base + std::ptrdiff_t(FIELD_CHUNK) * field_offset(shape, l);
                T* d_weights = sums + offsets[l];
                T* d_bias = d_weights + std::size_t(layer.outputs) * std::size_t(layer.padded_inputs);
                for (int p = 0; p < FIELD_CHUNK; p++)
                    for (int o = 0; o < layer.padded_outputs; o += WIDTH<T>)
                        store(d_bias + o, load<T, V>(d_bias + o) + load<T, V>(gradient + p * layer.padded_outputs + o));
                Product<T> weights{FIELD_CHUNK, gradient, 1, layer.padded_outputs, input, layer.padded_inputs};
                weights.c = d_weights, weights.c_row = layer.padded_inputs, weights.add = true;
                product<T>(weights, layer.outputs, layer.padded_inputs);
                const T* rows = packed[l].get();
                Product<T> inputs{layer.outputs, gradient, layer.padded_outputs, 1, rows, layer.padded_inputs};
                inputs.c = below, inputs.c_row = layer.padded_inputs;
                product<T>(inputs, FIELD_CHUNK, layer.padded_inputs);
                if (l > 0)
                    for (int i = 0; i < FIELD_CHUNK * layer.padded_inputs; i += WIDTH<T>) {
                        const Wide<T> zero{}, active = load<T, V>(input + i), g = load<T, V>(below + i);
                        store<T>(below + i, active > zero ? g : zero);
                    }
                T* swap = gradient;
                gradient = below;
                below = swap;
            }
            for (int level = 0; level < shape.levels; level++)
                for (int p = 0; p < points; p++)
                    for (int f = 0; f < shape.features; f++)
                        encoding_gradients.get()[(std::int64_t(level) * job.count + first + p) * shape.features + f] =
                            gradient[p * encoded + level * shape.features + f];
        }
    };
    parallel_for(blocks, threads, block);

    for (int l = 0; l <= shape.layers; l++) {
        const FieldLayer layer = field_layer(shape, l);
        for (int o = 0; o < layer.outputs; o++)
            for (int i = 0; i <= layer.inputs; i++) {  // the last one is the bias
                const std::size_t at =
                    offsets[l] + (i < layer.inputs ? std::size_t(o) * std::size_t(layer.padded_inputs) + i
                                                   : std::size_t(layer.outputs) * layer.padded_inputs + o);
                T total = 0;
                for (int b = 0; b < blocks; b++) total += partial.get()[stride * std::size_t(b) + at];
                if (i < layer.inputs)
                    grad.d_weights[l][o * layer.inputs + i] = total;
                else
                    grad.d_biases[l][o] = total;
            }
    }

    auto table = [&](int level) {
        T* d_table = grad.d_table;
        for (std::int64_t i = job.level_rows[level] * shape.features; i < job.level_rows[level + 1] * shape.features;
             i++)
            d_table[i] = 0;
        for (std::int64_t p = 0; p < job.count; p++) {
            const std::int64_t at = std::int64_t(level) * job.count + p;
            const T* g = encoding_gradients.get() + at * shape.features;
            spread_point<T>(d_table, job.rows + 8 * at, job.corner_weights + 8 * at, shape.features, g);
        }
    };
    parallel_for(shape.levels, threads, table);
}

}  // namespace vs::VS_ISA
