// The kernels of the running CPU. Not in kernel.h: dense.cpp, which is compiled for CPUs that this
// one may not be, shares no code with what is compiled for all.
#pragma once

#include <vector>

#include "kernel.h"

namespace sumo {

// Those that this CPU can run: the portable one first, the fastest last.
const std::vector<const Kernel*>& kernels();

}  // namespace sumo
