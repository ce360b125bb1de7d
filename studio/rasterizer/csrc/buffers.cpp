#include "buffers.h"

#include <cstdlib>
#include <mutex>
#include <new>
#include <stdexcept>
#include <vector>

namespace vs {
namespace {

struct IdleBuffer {
    void* pointer;
    std::size_t capacity;
};

constexpr std::size_t MAX_IDLE_BYTES = std::size_t(256) << 20;
constexpr std::size_t MAX_IDLE_BUFFERS = 32;

std::mutex mutex;
std::vector<IdleBuffer> idle;
std::size_t idle_bytes = 0;

}  // namespace

void* acquire_buffer(std::size_t bytes, std::size_t* capacity) {
    if (bytes == 0) bytes = 1;
    {
        std::lock_guard<std::mutex> guard(mutex);
        std::size_t best = idle.size();
        for (std::size_t i = 0; i < idle.size(); i++)
            if (idle[i].capacity >= bytes && idle[i].capacity <= 2 * bytes + 65536 &&
                (best == idle.size() || idle[i].capacity < idle[best].capacity))
                best = i;
        if (best < idle.size()) {
            IdleBuffer found = idle[best];
            idle[best] = idle.back();
            idle.pop_back();
            idle_bytes -= found.capacity;
            *capacity = found.capacity;
            return found.pointer;
        }
    }
    std::size_t rounded =
        (bytes + bytes / 8 + 4095) / 4096 * 4096;  // headroom: the number of splats changes during training
    void* pointer = std::aligned_alloc(64, rounded);
    if (pointer == nullptr) throw std::bad_alloc();
    *capacity = rounded;
    return pointer;
}

void release_buffer(void* pointer, std::size_t capacity) {
    {
        std::lock_guard<std::mutex> guard(mutex);
        if (idle.size() < MAX_IDLE_BUFFERS && idle_bytes + capacity <= MAX_IDLE_BYTES) {
            idle.push_back({pointer, capacity});
            idle_bytes += capacity;
            return;
        }
    }
    std::free(pointer);
}

void release_idle_buffers() {
    std::lock_guard<std::mutex> guard(mutex);
    for (const IdleBuffer& buffer : idle) std::free(buffer.pointer);
    idle.clear();
    idle_bytes = 0;
}

void throw_too_many_tiles() {
    throw std::length_error("The splats touch more than 4 billion tiles: there are too many, or they are too large.");
}

}  // namespace vs
