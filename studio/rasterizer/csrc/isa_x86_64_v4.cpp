// Compiled with -march=x86-64-v4: AVX-512, in Intel servers since 2017 and AMD processors since 2022.
#define VS_ISA x86_64_v4
#define VS_ISA_NAME "x86-64-v4"
#include "isa.h"
