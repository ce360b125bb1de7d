// Arrays that come from Python by DLPack, and checks of them, for the files that define functions of the module.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <cstddef>
#include <stdexcept>
#include <string>

namespace nb = nanobind;

namespace vs {

template <typename T>
using In = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;
template <typename T>
using Out = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

template <typename A>
void expect(const A& array, std::size_t size, const char* name) {
    if (array.size() != size)
        throw std::invalid_argument(std::string(name) + " has " + std::to_string(array.size()) + " values, expected " +
                                    std::to_string(size));
}

// An array argument, which is not converted or copied.
inline auto array(const char* name) { return nb::arg(name).noconvert(); }

inline int checked_threads(int threads) {
    if (threads < 1) return 1;
    return threads > 256 ? 256 : threads;
}

void add_dequantize(nb::module_& m);  // dequantize.cpp

}  // namespace vs
