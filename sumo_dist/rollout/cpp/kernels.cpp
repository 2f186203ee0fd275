#include "kernels.h"

namespace sumo {

extern const Kernel kPortableKernel;
#ifdef SUMO_HAS_AVX
extern const Kernel kAvx2Kernel;
extern const DenseFunction kAvx512Dense;
#endif

namespace {

std::vector<const Kernel*> find_kernels() {
  std::vector<const Kernel*> found{&kPortableKernel};
#ifdef SUMO_HAS_AVX
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    found.push_back(&kAvx2Kernel);
    static const Kernel avx512{"avx512", kAvx2Kernel.bits, kAvx512Dense, kAvx2Kernel.normalise};
    // VBMI2 came with the generation that no longer lowers its clock much for wide vectors.
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vbmi2"))
      found.push_back(&avx512);
  }
#endif
  return found;
}

}  // namespace

const std::vector<const Kernel*>& kernels() {
  static const std::vector<const Kernel*> found = find_kernels();
  return found;
}

}  // namespace sumo
