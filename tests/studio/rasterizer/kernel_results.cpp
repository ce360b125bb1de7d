// Writes what the kernels compute for the scene of kernel_scene.h to standard output, as raw doubles: rendered and
// differentiated in double, the same in float, and the loss. Built for another processor and run in an emulator, it shows
// that the kernels compute the same there.

#include <cstdio>
#include <vector>

#include "kernel_scene.h"
#include "kernels.h"

namespace {

template <typename T>
void write(const std::vector<T>& values) {
    for (T value : values) {
        const double exact = double(value);
        require(std::fwrite(&exact, sizeof(exact), 1, stdout) == 1, "standard output can be written");
    }
}

}  // namespace

int main() {
    write(Scene<double>().render(vs::kernels_baseline, 2));
    write(Scene<float>().render(vs::kernels_baseline, 2));
    write(photometric_loss(vs::kernels_baseline, 2));
    return 0;
}
