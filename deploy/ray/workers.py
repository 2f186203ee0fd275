"""Rollout workers on a Ray cluster: python deploy/ray/workers.py ENDPOINT WORKERS [THREADS].

Each is an actor in a process of its own that Ray places, and starts again if its node is lost.
Ctrl-C ends them all. `ray` and `sumo-dist` have to be installed on the nodes.
"""

import sys
import threading

import ray

from sumo_dist.services.worker import WorkerOptions, run


@ray.remote(max_restarts=-1, max_task_retries=-1, max_concurrency=2)
class RolloutWorker:
    """Serves until it is stopped; a worker keeps nothing that a plan depends on."""

    def __init__(self, endpoint: str, threads: int) -> None:
        self._options = WorkerOptions(connect=endpoint, threads=threads)
        self._stop = threading.Event()

    def serve(self) -> None:
        """Roll out."""
        run(self._options, self._stop)

    def stop(self) -> None:
        """Leave the bus."""
        self._stop.set()


def main() -> None:
    """Start the workers and wait."""
    endpoint, count = sys.argv[1], int(sys.argv[2])
    threads = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    ray.init()
    workers = [
        RolloutWorker.options(num_cpus=threads).remote(endpoint, threads) for _ in range(count)
    ]
    serving = [worker.serve.remote() for worker in workers]
    try:
        ray.get(serving)
    except KeyboardInterrupt:
        ray.get([worker.stop.remote() for worker in workers])
        ray.wait(serving, num_returns=len(serving), timeout=5.0)


if __name__ == "__main__":
    main()
