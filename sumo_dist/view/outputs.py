"""Where an episode is written: an .rrd of bounded size, a live server on this machine, or both."""

from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.sinks import LogSinkLike

from sumo_dist.timing import TICK
from sumo_dist.view.rrd_file import RrdFile

APPLICATION = "sumo-dist"
TIMELINE = "sim_time"
SERVER_MEMORY = "200MB"  # kept for viewers that join late; what is older is dropped

_FLUSH_EVERY = 200  # writes; about a second of a live run
_FLUSH_TIMEOUT_S = 5.0


class LiveServer:
    """A server on 127.0.0.1 that viewers connect to and that outlives the episodes sent to it.

    Attributes:
        url: its address.
    """

    def __init__(self, port: int, memory: str = SERVER_MEMORY) -> None:
        """Serve on a port until closed; what does not fit into the memory is dropped."""
        # Without properties it is no recording of its own that viewers would list.
        self._stream = rr.RecordingStream(APPLICATION, send_properties=False)
        self.url: str = self._stream.serve_grpc(grpc_port=port, server_memory_limit=memory)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()


class Outputs:
    """The Rerun recording of one episode, sent to a file, a server or both."""

    def __init__(self, run_id: str, file: RrdFile | None = None, url: str | None = None) -> None:
        """Open the recording.

        Args:
            run_id: names it; two of the same id would be merged.
            file: what is logged is also written here; closed with the outputs.
            url: of a server, see `LiveServer`.
        """
        self._file = file
        self._stream = rr.RecordingStream(APPLICATION, recording_id=run_id)
        self._stream.set_log_time_enabled(False)  # robot time is the only clock in a run
        self._stream.set_log_tick_enabled(False)
        self._writes = 0
        self._encoded: rr.BinaryStream | None = None
        sinks: list[LogSinkLike] = []
        if file is not None:
            self._encoded = self._stream.binary_stream()
            sinks.append(self._encoded)
        if url is not None:
            sinks.append(rr.GrpcSink(url))
        self._stream.set_sinks(*sinks)

    def log(
        self, path: str | Sequence[str], *archetypes: rr.AsComponents, tick: int | None = None
    ) -> None:
        """Log at a tick, or for all time if none is given."""
        if tick is not None:
            self._stream.set_time(TIMELINE, duration=tick * TICK)
        place = path if isinstance(path, str) else list[object](path)
        self._stream.log(place, *archetypes, static=tick is None)
        self._count()

    def send(
        self, path: str, ticks: Sequence[int] | np.ndarray, columns: Iterable[rr.ComponentColumn]
    ) -> None:
        """Send one row a tick in one chunk."""
        times = rr.TimeColumn(TIMELINE, duration=np.asarray(ticks) * TICK)
        self._stream.send_columns(path, [times], columns)
        self._count()

    def arrange(self, blueprint: rrb.Blueprint) -> None:
        """Set the viewer's layout."""
        self._stream.send_blueprint(blueprint)

    def flush(self) -> None:
        """Bring the file up to date."""
        if self._file is not None and self._encoded is not None:
            self._file.append(self._encoded.read(flush_timeout_sec=_FLUSH_TIMEOUT_S) or b"")

    def close(self) -> None:
        """Finish the file and stop the server."""
        try:
            self.flush()
        finally:
            self._stream.disconnect()
            if self._file is not None:
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _count(self) -> None:
        self._writes += 1
        if self._writes % _FLUSH_EVERY == 0:
            self.flush()
