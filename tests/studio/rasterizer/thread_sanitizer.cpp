// Runs the thread pool and the kernels from many threads at once. Built with ThreadSanitizer (`make tsan`), which
// reports data races and then makes the program exit with 66. The program itself exits with 1 if a task was lost or
// repeated, or if a result depends on the number of threads. With the argument `race` it contains a data race on
// purpose: proof that the sanitizer is on.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

#include "buffers.h"
#include "kernels.h"
#include "threads.h"

namespace {

constexpr int CALLERS = 4, WORKERS = 5;

void require(bool condition, const char* what) {
    if (condition) return;
    std::fprintf(stderr, "failed: %s\n", what);
    std::exit(1);
}

template <typename F>
void run(int tasks, int threads, F body) {
    vs::run_tasks(tasks, threads, [](void* context, int task) { (*static_cast<F*>(context))(task); }, &body);
}

// Each task of each job runs exactly once, and its plain writes are visible to the caller.
void check_pool() {
    for (int round = 0; round < 300; round++) {
        const int tasks = round % 37;
        std::vector<int> calls(std::size_t(tasks), 0);
        run(tasks, 1 + round % WORKERS, [&](int task) { calls[std::size_t(task)] += 1; });
        for (int count : calls) require(count == 1, "each task runs once");
    }
}

// Two tasks that wait for each other, so that also on a busy machine no thread takes both. Relaxed: orders nothing else.
void provoke_race() {
    volatile int shared = 0;
    std::atomic<int> arrived{0};
    run(2, 2, [&](int) {
        arrived.fetch_add(1, std::memory_order_relaxed);
        while (arrived.load(std::memory_order_relaxed) < 2) std::this_thread::yield();
        for (int i = 0; i < 1000; i++) shared = shared + 1;
    });
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
        if constexpr (sizeof(T) == 4) {
            kernels.forward_float(splats, out, frame, threads);
            kernels.backward_float(splats, gradients, frame, threads);
        } else {
            kernels.forward_double(splats, out, frame, threads);
            kernels.backward_double(splats, gradients, frame, threads);
        }
        require(frame.pairs > COUNT, "the scene is visible");
        std::vector<T> all;
        for (const std::vector<T>* part :
             {&image, &alpha, &depth, &radii, &d_means, &d_quats, &d_log_scales, &d_logits, &d_sh, &d_offsets})
            all.insert(all.end(), part->begin(), part->end());
        return all;
    }
};

std::vector<float> photometric_loss(const vs::Kernels& kernels, int threads) {
    constexpr int WIDTH = 41, HEIGHT = 130;
    std::vector<float> image(3 * WIDTH * HEIGHT), target(image.size()), gradient(image.size());
    for (std::size_t i = 0; i < image.size(); i++) image[i] = float(i % 97) / 97, target[i] = float(i % 89) / 89;
    vs::LossJob job{WIDTH, HEIGHT, image.data(), target.data(), 0.2, gradient.data(), 0, 0};
    kernels.loss(job, threads);
    gradient.push_back(float(job.l1));
    gradient.push_back(float(job.ssim));
    return gradient;
}

template <typename T>
bool same_bits(const std::vector<T>& one, const std::vector<T>& other) {
    return one.size() == other.size() && std::memcmp(one.data(), other.data(), one.size() * sizeof(T)) == 0;
}

// Several callers at once: one has the pool, the others work alone, and all share the recycled buffers.
void check_kernels(const vs::Kernels& kernels) {
    const Scene<float> single;
    const Scene<double> exact;
    const auto single_truth = single.render(kernels, 1);
    const auto exact_truth = exact.render(kernels, 1);
    const auto loss_truth = photometric_loss(kernels, 1);
    std::vector<std::thread> callers;
    for (int caller = 0; caller < CALLERS; caller++)
        callers.emplace_back([&, caller] {
            for (int round = 0; round < 6; round++) {
                const int threads = 1 + (caller + round) % WORKERS;
                require(same_bits(single.render(kernels, threads), single_truth), "float: same bits");
                require(same_bits(exact.render(kernels, threads), exact_truth), "double: same bits");
                require(same_bits(photometric_loss(kernels, threads), loss_truth), "loss: same bits");
                if (round % 3 == 2) vs::release_idle_buffers();
            }
        });
    for (std::thread& caller : callers) caller.join();
}

}  // namespace

int main(int count, char** arguments) {
    if (count == 2 && std::strcmp(arguments[1], "race") == 0) {
        provoke_race();
        return 0;
    }
    std::vector<std::thread> callers;
    for (int caller = 0; caller < CALLERS; caller++) callers.emplace_back(check_pool);
    for (std::thread& caller : callers) caller.join();
    check_kernels(vs::kernels_baseline);
    std::printf("baseline: no lost task, same bits\n");
#if defined(VS_HAVE_X86_64)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2")) {
        check_kernels(vs::kernels_x86_64_v3);
        std::printf("x86-64-v3: no lost task, same bits\n");
    }
    if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl")) {
        check_kernels(vs::kernels_x86_64_v4);
        std::printf("x86-64-v4: no lost task, same bits\n");
    }
#endif
    return 0;
}
