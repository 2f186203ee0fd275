#include "kernel.h"

namespace sumo {

extern const Kernel kPortableKernel;
#ifdef SUMO_HAS_AVX2
extern const Kernel kAvx2Kernel;
#endif

const Kernel& portable_kernel() { return kPortableKernel; }

const Kernel& best_kernel() {
#ifdef SUMO_HAS_AVX2
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return kAvx2Kernel;
#endif
  return kPortableKernel;
}

}  // namespace sumo
