// A parallel loop over a lambda.
#pragma once

#include "isa_namespace.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

// Calls body(i) for each i in [0, tasks) on up to `threads` threads; see run_tasks.
template <typename F>
VS_INLINE void parallel_for(int tasks, int threads, F& body) {
    run_tasks(tasks, threads, [](void* context, int task) { (*static_cast<F*>(context))(task); }, &body);
}

}  // namespace vs::VS_ISA
