// Threads that live as long as the pool and share out the tasks of one call at a time.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace sumo {

class ThreadPool {
 public:
  using Task = std::function<void(int index, int thread)>;  // must not throw

  // The thread that calls run() is one of `threads`.
  explicit ThreadPool(int threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int size() const { return static_cast<int>(workers_.size()) + 1; }

  // Runs task(0) .. task(count - 1), each on whichever thread is free, until all are done.
  void run(int count, const Task& task);

 private:
  void serve(int thread);
  void work(std::unique_lock<std::mutex>& lock, int thread);

  std::mutex mutex_;
  std::condition_variable wake_, done_;
  const Task* task_ = nullptr;
  int count_ = 0, next_ = 0, finished_ = 0;
  bool stop_ = false;
  std::vector<std::thread> workers_;
};

}  // namespace sumo
