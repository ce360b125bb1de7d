// Compiled for what every processor of the architecture has: SSE2 on x86-64, NEON on aarch64.
#define VS_ISA baseline
#define VS_ISA_NAME "baseline"
#include "isa.h"
