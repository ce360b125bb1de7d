// A small scene for programs that call the kernels without Python: everything that both passes and the loss write.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include "kernels.h"

inline void require(bool condition, const char* what) {
    if (condition) return;
    std::fprintf(stderr, "failed: %s\n", what);
    std::exit(1);
}

template <typename T>
struct Scene {
    static constexpr int COUNT = 600, COEFFICIENTS = 4, WIDTH = 70, HEIGHT = 50;
    std::vector<T> means, quats, log_scales, logits, sh, offsets;

    Scene() : offsets(2 * COUNT, T(0)) {
        std::mt19937 random(7);
        std::normal_distribution<double> normal;
        auto fill = [&](std::vector<T>& values, int size, double factor, double offset) {
            for (int i = 0; i < size; i++) values.push_back(T(normal(random) * factor + offset));
        };
        fill(means, 3 * COUNT, 0.5, 0);
        fill(quats, 4 * COUNT, 1, 0);
        fill(log_scales, 3 * COUNT, 0.5, -3);
        fill(logits, COUNT, 2, 0);
        fill(sh, 3 * COEFFICIENTS * COUNT, 0.3, 0);
    }

    // Everything that a forward and a backward pass write.
    std::vector<T> render(const vs::Kernels& kernels, int threads) const {
        const std::size_t pixels = std::size_t(WIDTH) * HEIGHT;
        const vs::Splats<T> splats = {COUNT,         COEFFICIENTS, means.data(),  quats.data(), log_scales.data(),
                                      logits.data(), sh.data(),    offsets.data()};
        vs::Frame<T> frame;
        frame.camera = {{1, 0, 0, 0, 1, 0, 0, 0, 1},
                        {0, 0, 3},
                        {0, 0, -3},
                        60,
                        60,
                        WIDTH / 2.0,
                        HEIGHT / 2.0,
                        {-2, 2, -2, 2},
                        WIDTH,
                        HEIGHT,
                        0.01,
                        0.99,
                        0.3};
        const T background[3] = {T(0.2), T(0.5), T(1)};
        std::vector<T> image(3 * pixels), alpha(pixels), depth(pixels), radii(COUNT);
        const vs::Outputs<T> out = {background, 0, image.data(), alpha.data(), depth.data(), radii.data()};
        std::vector<T> d_image(3 * pixels, T(1)), d_alpha(pixels, T(0.5)), d_depth(pixels, T(0.1));
        std::vector<T> d_means(means.size()), d_quats(quats.size()), d_log_scales(log_scales.size());
        std::vector<T> d_logits(logits.size()), d_sh(sh.size()), d_offsets(offsets.size());
        const vs::Gradients<T> gradients = {image.data(),        alpha.data(),    depth.data(),   d_image.data(),
                                            d_alpha.data(),      d_depth.data(),  d_means.data(), d_quats.data(),
                                            d_log_scales.data(), d_logits.data(), d_sh.data(),    d_offsets.data()};
        kernels.of<T>().forward(splats, out, frame, threads);
        kernels.of<T>().backward(splats, gradients, frame, threads);
        require(frame.pairs > COUNT, "the scene is visible");
        std::vector<T> all;
        for (const std::vector<T>* part :
             {&image, &alpha, &depth, &radii, &d_means, &d_quats, &d_log_scales, &d_logits, &d_sh, &d_offsets})
            all.insert(all.end(), part->begin(), part->end());
        return all;
    }
};

inline std::vector<float> photometric_loss(const vs::Kernels& kernels, int threads) {
    constexpr int WIDTH = 41, HEIGHT = 130;
    std::vector<float> image(3 * WIDTH * HEIGHT), target(image.size()), gradient(image.size());
    for (std::size_t i = 0; i < image.size(); i++) image[i] = float(i % 97) / 97, target[i] = float(i % 89) / 89;
    vs::LossJob job{WIDTH, HEIGHT, image.data(), target.data(), 0.2, gradient.data(), 0, 0};
    kernels.loss(job, threads);
    gradient.push_back(float(job.l1));
    gradient.push_back(float(job.ssim));
    return gradient;
}
