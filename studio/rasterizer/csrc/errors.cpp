#include "errors.h"

#include <stdexcept>

namespace vs {

void throw_too_many_tiles() {
    throw std::length_error("The splats touch more than 4 billion tiles: there are too many, or they are too large.");
}

}  // namespace vs
