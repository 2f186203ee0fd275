// Rotation matrices of quaternions (w, x, y, z).
#pragma once

namespace sumo {

struct Rotation {
  double row[3][3];  // base to world

  // Component i of a world vector in the base's frame.
  double into_base(const double* world, int i) const {
    return row[0][i] * world[0] + row[1][i] * world[1] + row[2][i] * world[2];
  }
};

inline Rotation rotation(const double* quat) {
  const double w = quat[0], x = quat[1], y = quat[2], z = quat[3];
  return {{{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)},
           {2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)},
           {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)}}};
}

}  // namespace sumo
