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

inline void relax() {
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
        if (threads > int(workers_)) grow(threads - 1);
        // Withdraw the old ticket before the job's fields change: who still holds it cannot claim with it any more.
        ticket_.store(uint64_t(++epoch_) << 32 | NO_WORK);
        task_.store(task, std::memory_order_release);
        context_.store(context, std::memory_order_release);
        tasks_.store(tasks, std::memory_order_release);
        helpers_.store(threads - 1, std::memory_order_release);
        done_.store(0, std::memory_order_release);
        ticket_.store(uint64_t(++epoch_) << 32);
        if (sleepers_.load() > 0) {
            {
                std::lock_guard<std::mutex> guard(mutex_);
            }
            wake_.notify_all();
        }
        work();
        while (done_.load(std::memory_order_acquire) != tasks) {
            auto end = std::chrono::steady_clock::now() + SPIN;
            while (done_.load(std::memory_order_acquire) != tasks && std::chrono::steady_clock::now() < end)
                for (int i = 0; i < 16; i++) relax();
            if (done_.load(std::memory_order_acquire) != tasks) std::this_thread::yield();
        }
    }

  private:
    // Claim and do tasks of the present job until none is left. The job's fields are read before the claim: if the
    // claim succeeds, the ticket was not withdrawn in between, and they belong together.
    void work() {
        uint64_t ticket = ticket_.load(std::memory_order_acquire);
        for (;;) {
            Task task = task_.load(std::memory_order_acquire);
            void* context = context_.load(std::memory_order_acquire);
            int tasks = tasks_.load(std::memory_order_acquire);
            int index = int(ticket & 0xffffffffu);
            if (index >= tasks) {
                uint64_t now = ticket_.load(std::memory_order_acquire);
                if (now == ticket) return;
                ticket = now;
                continue;
            }
            if (ticket_.compare_exchange_weak(ticket, ticket + 1, std::memory_order_acq_rel)) {
                task(context, index);
                done_.fetch_add(1, std::memory_order_release);
                ticket = ticket_.load(std::memory_order_acquire);
            }
        }
    }

    void serve(int id) {
        uint32_t seen = 0;
        auto fresh = [&] { return uint32_t(ticket_.load() >> 32) != seen; };
        for (;;) {
            auto end = std::chrono::steady_clock::now() + SPIN;
            while (!fresh() && std::chrono::steady_clock::now() < end)
                for (int i = 0; i < 16; i++) relax();
            if (!fresh()) {
                std::unique_lock<std::mutex> lock(mutex_);
                sleepers_.fetch_add(1);
                wake_.wait(lock, fresh);
                sleepers_.fetch_sub(1);
            }
            seen = uint32_t(ticket_.load() >> 32);
            if (id < helpers_.load(std::memory_order_relaxed)) work();
        }
    }

    void grow(int wanted) {
        for (; workers_ < wanted; workers_++) std::thread(&Pool::serve, this, workers_).detach();
    }

    std::atomic<uint64_t> ticket_{0};  // epoch << 32 | next task
    std::atomic<Task> task_{nullptr};
    std::atomic<void*> context_{nullptr};
    std::atomic<int> tasks_{0}, helpers_{0}, done_{0}, sleepers_{0};
    uint32_t epoch_ = 0;
    int workers_ = 0;
    std::mutex mutex_;
    std::condition_variable wake_;
};

std::mutex busy;
Pool* pool = nullptr;  // never deleted: its threads may outlive static objects
pid_t pool_owner = 0;

}  // namespace

void run_tasks(int tasks, int threads, Task task, void* context) {
    if (threads > tasks) threads = tasks;
    if (threads > 1) {
        std::unique_lock<std::mutex> lock(busy, std::try_to_lock);
        if (lock.owns_lock()) {
            if (pool == nullptr || pool_owner != getpid()) {  // a forked child has none of its parent's threads
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
