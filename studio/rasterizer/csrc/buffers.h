// Working memory that is recycled from frame to frame. Without this, the operating system would map and clear the same
// pages for each frame, which takes longer than rendering a small image.
#pragma once

#include <cstddef>

namespace vs {

// At least `bytes` bytes, 64-byte aligned, contents undefined; writes the usable size to `capacity`. Throws
// std::bad_alloc.
void* acquire_buffer(std::size_t bytes, std::size_t* capacity);
// Returns a buffer for reuse, or frees it if enough are idle.
void release_buffer(void* pointer, std::size_t capacity);
// Frees all idle buffers.
void release_idle_buffers();

// Throws std::length_error: the number of splats or of (tile, splat) pairs exceeds 32 bits. Defined once, outside the
// code that is compiled per instruction set.
[[noreturn]] void throw_too_many_tiles();

// The same template is compiled for several instruction sets. Inlining keeps the linker from picking one copy for all.
#define VS_ALWAYS_INLINE __attribute__((always_inline))

// Owns one acquired buffer of `count` values, uninitialized. Move-only.
template <typename T>
class Buffer {
  public:
    Buffer() = default;
    VS_ALWAYS_INLINE explicit Buffer(std::size_t count)
        : data_(static_cast<T*>(acquire_buffer(count * sizeof(T), &capacity_))) {}
    VS_ALWAYS_INLINE Buffer(Buffer&& other) noexcept { *this = static_cast<Buffer&&>(other); }
    VS_ALWAYS_INLINE Buffer& operator=(Buffer&& other) noexcept {  // exchanges them
        const std::size_t capacity = capacity_;
        T* const data = data_;
        capacity_ = other.capacity_, data_ = other.data_;
        other.capacity_ = capacity, other.data_ = data;
        return *this;
    }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    VS_ALWAYS_INLINE ~Buffer() {
        if (data_ != nullptr) release_buffer(data_, capacity_);
    }
    VS_ALWAYS_INLINE T* get() const { return data_; }

  private:
    std::size_t capacity_ = 0;  // before data_, whose initialization writes it
    T* data_ = nullptr;
};

}  // namespace vs
