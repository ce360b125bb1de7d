// For every processor of the architecture: SSE2 on x86-64, NEON on aarch64.
#define VS_ISA baseline
#define VS_ISA_NAME "baseline"
#include "isa.h"
