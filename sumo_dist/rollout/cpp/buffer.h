// Cache-line aligned float storage.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>

namespace sumo {

class Buffer {
 public:
  explicit Buffer(std::size_t size)
      : data_(static_cast<float*>(::operator new(size * sizeof(float), kAlignment))) {
    std::fill_n(data_.get(), size, 0.0f);
  }

  float* data() { return data_.get(); }
  const float* data() const { return data_.get(); }

 private:
  static constexpr std::align_val_t kAlignment{64};
  struct Delete {
    void operator()(float* p) const { ::operator delete(p, kAlignment); }
  };
  std::unique_ptr<float[], Delete> data_;
};

}  // namespace sumo
