// A small pool of threads for loops of a few milliseconds. Workers wait for new work by spinning for a fifth of a
// millisecond, the time between two loops of a frame, and then sleep, so that a busy machine loses little to them; the
// caller works along and needs no worker to wake up to get done.
#pragma once

namespace vs {

using Task = void (*)(void* context, int task);

// Call task(context, i) for each i in [0, tasks) on up to `threads` threads and wait for all. Tasks must not throw.
// Tasks are handed out in order. A second caller at the same time does its work alone, in its own thread.
void run_tasks(int tasks, int threads, Task task, void* context);

}  // namespace vs
