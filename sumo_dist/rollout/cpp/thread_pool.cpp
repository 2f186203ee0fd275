#include "thread_pool.h"

namespace sumo {

ThreadPool::ThreadPool(int threads) {
  for (int thread = 1; thread < threads; ++thread)
    workers_.emplace_back(&ThreadPool::serve, this, thread);
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(int count, const Task& task) {
  std::unique_lock<std::mutex> lock(mutex_);
  task_ = &task;
  count_ = count;
  next_ = finished_ = 0;
  if (count > 1) wake_.notify_all();
  work(lock, 0);
  done_.wait(lock, [this] { return finished_ == count_; });
}

void ThreadPool::serve(int thread) {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stop_ || next_ < count_; });
    if (stop_) return;
    work(lock, thread);
  }
}

void ThreadPool::work(std::unique_lock<std::mutex>& lock, int thread) {
  while (next_ < count_) {
    const int index = next_++;
    lock.unlock();
    (*task_)(index, thread);
    lock.lock();
    if (++finished_ == count_) done_.notify_one();
  }
}

}  // namespace sumo
