// Runs the thread pool and the kernels from many threads at once. Built with ThreadSanitizer (`make tsan`), which
// reports data races and then makes the program exit with 66. The program itself exits with 1 if a task was lost or
// repeated, or if a result depends on the number of threads. With the argument `race` it contains a data race on
// purpose: proof that the sanitizer is on.

#include <atomic>
#include <cstdio>
#include <cstring>
#include <thread>
#include <vector>

#include "buffers.h"
#include "kernel_scene.h"
#include "kernels.h"
#include "threads.h"

namespace {

constexpr int CALLERS = 4, WORKERS = 5;

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
