// Memory for one frame's working arrays, kept for the next frame: the kernel would otherwise hand out and clear the
// same pages again and again, which costs more than drawing a small image.
#pragma once

#include <cstddef>

namespace vs {

void* take_buffer(std::size_t bytes,
                  std::size_t* capacity);  // 64-byte aligned, contents undefined; may throw bad_alloc
void give_buffer(void* pointer, std::size_t capacity);
void release_idle_buffers();

// Always inlined: the same template is compiled for several instruction sets, and the linker must not choose between
// them.
#define VS_ALWAYS_INLINE __attribute__((always_inline))

template <typename T>
class Buffer {
  public:
    Buffer() = default;
    VS_ALWAYS_INLINE explicit Buffer(std::size_t count)
        : data_(static_cast<T*>(take_buffer(count * sizeof(T), &capacity_))) {}
    VS_ALWAYS_INLINE Buffer(Buffer&& other) noexcept : data_(other.data_), capacity_(other.capacity_) {
        other.data_ = nullptr;
    }
    VS_ALWAYS_INLINE Buffer& operator=(Buffer&& other) noexcept {
        if (this != &other) {
            free();
            data_ = other.data_;
            capacity_ = other.capacity_;
            other.data_ = nullptr;
        }
        return *this;
    }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    VS_ALWAYS_INLINE ~Buffer() { free(); }
    VS_ALWAYS_INLINE T* get() const { return data_; }

  private:
    VS_ALWAYS_INLINE void free() {
        if (data_ != nullptr) give_buffer(data_, capacity_);
        data_ = nullptr;
    }
    T* data_ = nullptr;
    std::size_t capacity_ = 0;
};

}  // namespace vs
