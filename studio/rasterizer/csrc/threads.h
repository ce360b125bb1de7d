// A thread pool for loops that take a few milliseconds. Idle workers spin for 0.2 ms, which spans the gap between two
// loops of one frame, and then sleep, so that they cost a busy machine little. The calling thread works too, so a loop
// finishes even if no worker wakes up.
#pragma once

#include "isa_namespace.h"

namespace vs {

using Task = void (*)(void* context, int task);

// Calls task(context, i) for each i in [0, tasks), in increasing order of i, on up to `threads` threads, and waits for
// all calls to finish. Tasks must not throw. Thread-safe: while the pool is busy, a second caller runs its tasks alone
// in its own thread.
void run_tasks(int tasks, int threads, Task task, void* context);

}  // namespace vs

namespace vs::VS_ISA {

// Calls body(i) for each i in [0, tasks) on up to `threads` threads; see run_tasks.
template <typename F>
VS_INLINE void parallel_for(int tasks, int threads, F& body) {
    run_tasks(tasks, threads, [](void* context, int task) { (*static_cast<F*>(context))(task); }, &body);
}

}  // namespace vs::VS_ISA
