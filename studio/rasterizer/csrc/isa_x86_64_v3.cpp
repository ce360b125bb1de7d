// Compiled with -march=x86-64-v3: AVX2 and FMA, in Intel processors since 2013 and AMD since 2015.
#define VS_ISA x86_64_v3
#define VS_ISA_NAME "x86-64-v3"
#include "isa.h"
