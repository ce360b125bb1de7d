#include "threads.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>

#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>
#endif

namespace vs {
namespace {

inline void cpu_pause() {
#if defined(__x86_64__) || defined(__i386__)
    _mm_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

constexpr uint64_t NO_WORK = 0x7fffffff;
constexpr auto SPIN = std::chrono::microseconds(200);

class Pool {
  public:
    void run(int tasks, int threads, Task task, void* context) {
        if (threads > int(workers_)) add_workers(threads - 1);
        // Invalidate the old ticket before the fields of the job change, so that no thread can claim a task with it.
        ticket_.store(uint64_t(++epoch_) << 32 | NO_WORK);
        task_.store(task, std::memory_order_release);
        context_.store(context, std::memory_order_release);
        tasks_.store(tasks, std::memory_order_release);
        helpers_.store(threads - 1, std::memory_order_release);
        finished_.store(0, std::memory_order_release);
        ticket_.store(uint64_t(++epoch_) << 32);
        if (sleepers_.load() > 0) {
            {
                std::lock_guard<std::mutex> guard(mutex_);
            }
            wake_.notify_all();
        }
        run_claimed_tasks();
        while (finished_.load(std::memory_order_acquire) != tasks) {
            auto end = std::chrono::steady_clock::now() + SPIN;
            while (finished_.load(std::memory_order_acquire) != tasks && std::chrono::steady_clock::now() < end)
                for (int i = 0; i < 16; i++) cpu_pause();
            if (finished_.load(std::memory_order_acquire) != tasks) std::this_thread::yield();
        }
    }

  private:
    // Claims and runs tasks of the current job until none is left. The fields of the job are read before the claim. If
    // the claim succeeds, the ticket was still valid, so the fields all belong to this job.
    void run_claimed_tasks() {
        uint64_t ticket = ticket_.load(std::memory_order_acquire);
        for (;;) {
            Task task = task_.load(std::memory_order_acquire);
            void* context = context_.load(std::memory_order_acquire);
            int tasks = tasks_.load(std::memory_order_acquire);
            int index = int(ticket & 0xffffffffu);
            if (index >= tasks) {
                uint64_t current = ticket_.load(std::memory_order_acquire);
                if (current == ticket) return;
                ticket = current;
                continue;
            }
            if (ticket_.compare_exchange_weak(ticket, ticket + 1, std::memory_order_acq_rel)) {
                task(context, index);
                finished_.fetch_add(1, std::memory_order_release);
                ticket = ticket_.load(std::memory_order_acquire);
            }
        }
    }

    void worker_loop(int id) {
        uint32_t last_epoch = 0;
        auto has_new_job = [&] { return uint32_t(ticket_.load() >> 32) != last_epoch; };
        for (;;) {
            auto end = std::chrono::steady_clock::now() + SPIN;
            while (!has_new_job() && std::chrono::steady_clock::now() < end)
                for (int i = 0; i < 16; i++) cpu_pause();
            if (!has_new_job()) {
                std::unique_lock<std::mutex> lock(mutex_);
                sleepers_.fetch_add(1);
                wake_.wait(lock, has_new_job);
                sleepers_.fetch_sub(1);
            }
            last_epoch = uint32_t(ticket_.load() >> 32);
            if (id < helpers_.load(std::memory_order_relaxed)) run_claimed_tasks();
        }
    }

    void add_workers(int count) {
        for (; workers_ < count; workers_++) std::thread(&Pool::worker_loop, this, workers_).detach();
    }

    std::atomic<uint64_t> ticket_{0};  // epoch << 32 | index of the next task
    std::atomic<Task> task_{nullptr};
    std::atomic<void*> context_{nullptr};
    std::atomic<int> tasks_{0}, helpers_{0}, finished_{0}, sleepers_{0};
    uint32_t epoch_ = 0;
    int workers_ = 0;
    std::mutex mutex_;
    std::condition_variable wake_;
};

std::mutex pool_mutex;
Pool* pool = nullptr;  // never deleted: its threads may outlive static objects
pid_t pool_owner = 0;

}  // namespace

void run_tasks(int tasks, int threads, Task task, void* context) {
    if (threads > tasks) threads = tasks;
    if (threads > 1) {
        std::unique_lock<std::mutex> lock(pool_mutex, std::try_to_lock);
        if (lock.owns_lock()) {
            if (pool == nullptr ||
                pool_owner != getpid()) {  // the threads of the parent do not exist in a forked child
                pool = new Pool();
                pool_owner = getpid();
            }
            pool->run(tasks, threads, task, context);
            return;
        }
    }
    for (int i = 0; i < tasks; i++) task(context, i);
}

}  // namespace vs
